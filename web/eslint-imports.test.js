/** The rules for imports report what they are there for: a wrong direction, and a circle, also one of types alone. */
import { join } from "node:path";
import { Linter } from "eslint";
import tseslint from "typescript-eslint";
import { expect, it } from "vitest";
import config from "./eslint.config.js";
import imports from "./eslint-imports.js";

const TABLE = config.map(({ rules }) => rules?.["imports/direction"]).find(Array.isArray);

/** What is reported of a file with this text; its path is within src/. */
function reported(path, text) {
  const linter = new Linter({ configType: "flat", cwd: import.meta.dirname });
  const rules = { "imports/direction": TABLE ?? "off", "imports/no-cycle": "error" };
  const languageOptions = { parser: tseslint.parser };
  const files = ["**/*.ts", "**/*.tsx"];
  const messages = linter.verify(text, [{ files, languageOptions, plugins: { imports }, rules }], {
    filename: join(import.meta.dirname, "src", path),
  });
  return messages.map(({ ruleId, message }) => ruleId ?? message);
}

it("lets a folder import only what the table allows", () => {
  expect(reported("wire/new.ts", 'import { useStore } from "../state/store";')).toEqual([
    "imports/direction",
  ]);
  expect(reported("state/new.ts", 'import type { Screen } from "../acp/connection/connection";')).toEqual([
    "imports/direction",
  ]);
  expect(reported("state/new.ts", 'import type { Telemetry } from "../wire/telemetry";')).toEqual([]);
});

it("keeps the dashboard's components out of the kiosk, also where they are loaded later", () => {
  const text = 'const header = import("../components/header/header");';
  expect(reported("kiosk/new.tsx", text)).toEqual(["imports/direction"]);
  expect(reported("kiosk/new.tsx", 'import { Mark } from "../components/common/mark";')).toEqual([]);
});

it("reports a circle, also one of types alone", () => {
  expect(reported("state/store.ts", 'import type { AlertKind } from "./alerts";')).toEqual([
    "imports/no-cycle",
  ]);
});
