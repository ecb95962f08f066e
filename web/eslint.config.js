/** The rules that the web app's code is held to: strict types, one direction of imports, the rules of hooks, accessible markup. */
import js from "@eslint/js";
import jsxA11y from "eslint-plugin-jsx-a11y";
import reactHooks from "eslint-plugin-react-hooks";
import globals from "globals";
import tseslint from "typescript-eslint";
import imports from "./eslint-imports.js";

const DATA = ["browser-storage.ts", "screen.ts", "wire", "i18n", "state"];
const ACTIONS = [...DATA, "acp", "scene", "attention"];

/** From which folders and files each folder of src/ may import. Tests may import from anywhere. */
const MAY_IMPORT = {
  wire: [],
  i18n: ["browser-storage.ts", "screen.ts", "wire"],
  state: ["wire", "i18n"],
  api: ["wire"],
  scene: ["browser-storage.ts", "wire"],
  acp: [...DATA, "api"],
  attention: [...DATA, "acp"],
  hooks: ACTIONS,
  // What both screens use. It must stay small: every visitor's kiosk loads it.
  "components/common": [...ACTIONS, "hooks"],
  components: [...ACTIONS, "hooks", "components/common"],
  kiosk: [...ACTIONS, "hooks", "components/common"],
};

/** Only the modules that give such a name may write it; everybody else uses the constant. */
const OWN_NAMES = [
  {
    selector: "Literal[value=/^(robot-acp\\u002f|_robot\\u002f)/]",
    message: "Use META or METHODS of wire/, or STORAGE of browser-storage.ts.",
  },
];

export default tseslint.config(
  { ignores: ["dist", "node_modules", "coverage"] },
  js.configs.recommended,
  {
    files: ["**/*.js"],
    languageOptions: { globals: globals.node },
  },
  {
    files: ["**/*.{ts,tsx}"],
    plugins: { imports, "react-hooks": reactHooks },
    extends: [...tseslint.configs.strictTypeChecked, ...tseslint.configs.stylisticTypeChecked],
    languageOptions: {
      globals: globals.browser,
      parserOptions: { projectService: true, tsconfigRootDir: import.meta.dirname },
    },
    rules: {
      ...reactHooks.configs.recommended.rules,
      "react-hooks/exhaustive-deps": "error",
      "imports/no-cycle": "error",
      "no-restricted-syntax": ["error", ...OWN_NAMES],
      "@typescript-eslint/restrict-template-expressions": ["error", { allowNumber: true }],
      "@typescript-eslint/dot-notation": "off",
      "@typescript-eslint/no-unused-vars": ["error", { varsIgnorePattern: "^_", ignoreRestSiblings: true }],
      "@typescript-eslint/no-confusing-void-expression": ["error", { ignoreArrowShorthand: true }],
    },
  },
  {
    files: ["src/**/*.{ts,tsx}"],
    ignores: ["src/**/*.test.{ts,tsx}"],
    rules: { "imports/direction": ["error", MAY_IMPORT] },
  },
  {
    files: ["src/wire/{meta,methods}.ts", "src/browser-storage.ts", "src/attention/notification.ts"],
    rules: { "no-restricted-syntax": "off" },
  },
  {
    files: ["**/*.tsx"],
    extends: [jsxA11y.flatConfigs.strict],
  },
);
