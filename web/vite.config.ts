/** How the web app is built, served while one works on it, and tested. The bridge is at 127.0.0.1:8080, or at ROBOT_ACP_WEB_BRIDGE. */
import react from "@vitejs/plugin-react";
import { defineConfig } from "vitest/config";
import { kioskStaysSmall } from "./build-check.ts";

const bridge = process.env["ROBOT_ACP_WEB_BRIDGE"] ?? "http://127.0.0.1:8080";
// The bridge compares Origin with Host, so both have to name it.
const proxied = { target: bridge, changeOrigin: true, ws: true, headers: { origin: bridge } };

/** Tests with a page: those that render, and those of modules that use the browser. They cost ten times as much. */
const WITH_PAGE = ["src/**/*.test.tsx", "src/**/*.dom.test.ts"];

export default defineConfig({
  plugins: [react(), kioskStaysSmall()],
  server: {
    host: "127.0.0.1",
    proxy: { "/acp": proxied, "/api": proxied, "/scene": proxied },
  },
  build: { target: "es2022", sourcemap: false, chunkSizeWarningLimit: 900 },
  test: {
    restoreMocks: true,
    unstubGlobals: true,
    // One set of modules for all files of a worker takes a quarter of the time. A file that needs the state of another
    // fails in some order: the first lines show the seed.
    isolate: false,
    sequence: { shuffle: { files: true } },
    projects: [
      {
        extends: true,
        test: {
          name: "data",
          environment: "node",
          include: ["*.test.{js,ts}", "src/**/*.test.ts"],
          exclude: WITH_PAGE,
          setupFiles: ["src/test-setup.ts"],
        },
      },
      {
        extends: true,
        test: {
          name: "page",
          environment: "jsdom",
          include: WITH_PAGE,
          setupFiles: ["src/test-setup.ts", "src/test-setup-dom.ts"],
        },
      },
    ],
    coverage: {
      provider: "v8",
      include: ["src/**/*.{ts,tsx}"],
      exclude: ["src/**/*.test.{ts,tsx}", "src/test-setup*.ts", "src/**/fake-*.ts", "src/i18n/locales/**"],
      reporter: ["text-summary", "json-summary"],
    },
  },
});
