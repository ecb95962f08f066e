/** How the web app is built, served while one works on it, and tested. The bridge is at 127.0.0.1:8080, or at ROBOT_ACP_WEB_BRIDGE. */
import react from "@vitejs/plugin-react";
import { defineConfig } from "vitest/config";

const bridge = process.env["ROBOT_ACP_WEB_BRIDGE"] ?? "http://127.0.0.1:8080";
// The bridge compares Origin with Host, so both have to name it.
const proxied = { target: bridge, changeOrigin: true, ws: true, headers: { origin: bridge } };

export default defineConfig({
  plugins: [react()],
  server: {
    host: "127.0.0.1",
    proxy: { "/acp": proxied, "/api": proxied, "/scene": proxied },
  },
  build: { target: "es2022", sourcemap: false, chunkSizeWarningLimit: 900 },
  test: {
    environment: "jsdom",
    include: ["src/**/*.test.{ts,tsx}"],
    setupFiles: ["src/test-setup.ts"],
    restoreMocks: true,
  },
});
