/** Fails a build in which the kiosk loads what belongs to the dashboard: its components, its styles, Radix. */
import type { Plugin, Rollup } from "vite";

const KIOSK = "/src/kiosk/kiosk.tsx";
const FOREIGN = [
  /\/node_modules\/(?:radix-ui|@radix-ui)\//,
  /\/src\/components\/(?!common\/)/,
  /\/src\/styles\/dashboard\.css/,
];

/** The files of a chunk, and of all chunks that are loaded with it. */
function filesLoadedWith(start: Rollup.OutputChunk, bundle: Rollup.OutputBundle): string[] {
  const chunks = new Set([start]);
  for (const chunk of chunks) {
    for (const name of chunk.imports) {
      const next = bundle[name];
      if (next?.type === "chunk") chunks.add(next);
    }
  }
  return [...chunks].flatMap(({ moduleIds }) => moduleIds);
}

export function kioskStaysSmall(): Plugin {
  return {
    name: "kiosk-stays-small",
    apply: "build",
    generateBundle(_options, bundle) {
      const chunks = Object.values(bundle).filter((output) => output.type === "chunk");
      const kiosk = chunks.find(({ facadeModuleId }) => facadeModuleId?.endsWith(KIOSK));
      const entry = chunks.find(({ isEntry }) => isEntry);
      if (kiosk === undefined || entry === undefined) throw new Error("the kiosk has no chunk of its own");
      const files = [...filesLoadedWith(entry, bundle), ...filesLoadedWith(kiosk, bundle)];
      const foreign = files.filter((file) => FOREIGN.some((pattern) => pattern.test(file)));
      if (foreign.length > 0)
        throw new Error(`the kiosk loads files of the dashboard: ${foreign.join(", ")}`);
    },
  };
}
