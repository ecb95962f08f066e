/**
 * Two rules of our own for imports within src/, types included: which folder may import from which, and no circles. The
 * rules of the well-known plugins let circles of types pass. The folders are the table in eslint.config.js.
 */
import { existsSync, readFileSync, statSync } from "node:fs";
import { dirname, join, relative, resolve, sep } from "node:path";
import ts from "typescript";

const SRC = join(import.meta.dirname, "src");
const ENDINGS = ["", ".ts", ".tsx", "/index.ts"];

/** The file that a relative import names; null for a package, and for what is no TypeScript. */
function fileOf(specifier, importer) {
  if (!specifier.startsWith(".")) return null;
  const base = resolve(dirname(importer), specifier);
  const found = ENDINGS.map((ending) => base + ending).find(
    (path) => existsSync(path) && statSync(path).isFile(),
  );
  return found !== undefined && /\.tsx?$/.test(found) ? found : null;
}

/** The files that a file imports, by path; read again when the file has changed, as an editor needs it. */
const cache = new Map();
function importsOf(file) {
  const changedAt = statSync(file).mtimeMs;
  const known = cache.get(file);
  if (known?.changedAt === changedAt) return known.files;
  const specifiers = ts.preProcessFile(readFileSync(file, "utf8"), true, true).importedFiles;
  const files = specifiers.map(({ fileName }) => fileOf(fileName, file)).filter((path) => path !== null);
  cache.set(file, { changedAt, files });
  return files;
}

/** The shortest way from `start` to `goal` along imports, both included; null when there is none. */
function wayBetween(start, goal) {
  const before = new Map([[start, null]]);
  for (const file of before.keys()) {
    if (file === goal) {
      const way = [];
      for (let at = file; at !== null; at = before.get(at)) way.unshift(at);
      return way;
    }
    for (const next of importsOf(file)) if (!before.has(next)) before.set(next, file);
  }
  return null;
}

const nameOf = (file) => relative(SRC, file).split(sep).join("/");

/** Calls `check(file, node)` for each file that the linted file imports. */
function visitor(importer, check) {
  const visit = (node) => {
    const source = node.source ?? node.argument?.literal ?? node.argument;
    const file = typeof source?.value === "string" ? fileOf(source.value, importer) : null;
    if (file !== null) check(file, node);
  };
  return {
    ImportDeclaration: visit,
    ExportNamedDeclaration: visit,
    ExportAllDeclaration: visit,
    ImportExpression: visit,
    TSImportType: visit,
  };
}

const noCycle = {
  meta: {
    type: "problem",
    schema: [],
    messages: { cycle: "Files import each other in a circle: {{way}}" },
  },
  create(context) {
    return visitor(context.filename, (file, node) => {
      const way = wayBetween(file, context.filename);
      if (way === null) return;
      const names = [context.filename, ...way].map(nameOf).join(" → ");
      context.report({ node, messageId: "cycle", data: { way: names } });
    });
  },
};

/** The deepest folder of the table that a file is in; null for the files of src/ itself. */
function folderOf(file, table) {
  const inside = Object.keys(table).filter((folder) => nameOf(file).startsWith(`${folder}/`));
  return inside.sort((a, b) => b.length - a.length)[0] ?? null;
}

const direction = {
  meta: {
    type: "problem",
    schema: [{ type: "object", additionalProperties: { type: "array", items: { type: "string" } } }],
    messages: {
      forbidden: "{{from}}/ may not import from {{to}}: see the table in eslint.config.js.",
    },
  },
  create(context) {
    const [table] = context.options;
    const from = folderOf(context.filename, table);
    if (from === null) return {};
    return visitor(context.filename, (file, node) => {
      const to = folderOf(file, table) ?? nameOf(file);
      if (to === from || table[from].includes(to)) return;
      context.report({ node, messageId: "forbidden", data: { from, to } });
    });
  },
};

export default { rules: { "no-cycle": noCycle, direction } };
