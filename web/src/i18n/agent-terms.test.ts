/** What is known is said in the reader's language; what is not, or only looks like it, stays as it came. */
import { afterEach, beforeEach, describe, expect, it } from "vitest";
import i18next from ".";
import { argumentWords, callWords, modeName, modeWords, settingName, toolWords } from "./agent-terms";

const drive = { tool: "navigate_to_place", input: { place: "lab 2.3.7" }, title: "Drive to lab 2.3.7" };
const OBSERVE = "Looks and answers; nothing moves, nothing is said aloud.";

describe("in English", () => {
  it("says what the robot's own titles say", () => {
    expect(callWords(drive)).toBe("Drive to lab 2.3.7");
    expect(toolWords("speak", "Say something aloud")).toBe("Say something aloud");
  });

  it("never gives a call of another robot's the name of one of ours", () => {
    const send = { tool: "speak", input: { text: "hi" }, title: "Send as a message: “hi”" };
    expect(callWords(send)).toBe("Send as a message: “hi”");
    expect(callWords({ ...drive, title: "Drive to lab 2.3.9" })).toBe("Drive to lab 2.3.9");
    expect(toolWords("speak", "Send as a message")).toBe("Send as a message");
    expect(settingName("mode", "Gearbox")).toBe("Gearbox");
  });
});

describe("in Spanish", () => {
  beforeEach(async () => {
    await i18next.changeLanguage("es");
  });
  afterEach(async () => {
    await i18next.changeLanguage("en");
  });

  it("says what a known call does, with its arguments as they are", () => {
    expect(callWords(drive)).toBe("Ir a lab 2.3.7");
    const said = "Costs $t(mode.plan) and {{text}} & <b>";
    expect(callWords({ tool: "speak", input: { text: said }, title: `Say aloud: “${said}”` })).toBe(
      `Decir en voz alta: «${said}»`,
    );
    expect(toolWords("speak", "Say something aloud")).toBe("Decir algo en voz alta");
  });

  it.each(["Drive to (4.25, -3)", "Drive to (4.25, -3.0)"])(
    "reads a number as Python writes it: %s",
    (title) => {
      const call = { tool: "navigate_to_pose", input: { x: 4.25, y: -3 }, title };
      expect(callWords(call)).toBe("Ir a (4.25; -3)");
    },
  );

  it("leaves a call whose title says something else", () => {
    expect(callWords({ ...drive, title: "Drive to lab 2.3.7 and back" })).toBe("Drive to lab 2.3.7 and back");
    expect(toolWords("speak", "Send as a message")).toBe("Send as a message");
  });

  it("leaves what is not known as it came", () => {
    expect(callWords({ tool: "polish_floor", input: {}, title: "Polish the floor" })).toBe(
      "Polish the floor",
    );
    expect(callWords({ tool: "guest__speak", input: { text: "hi" }, title: "guest: Speak" })).toBe(
      "guest: Speak",
    );
    expect(callWords({ tool: "constructor", input: {}, title: "Build" })).toBe("Build");
    expect(callWords({ ...drive, tool: null })).toBe("Drive to lab 2.3.7");
    expect(toolWords("polish_floor", "Polish the floor")).toBe("Polish the floor");
    expect(modeName("plan-mode")).toBe("plan-mode");
    expect(settingName("temperature", "Temperature")).toBe("Temperature");
  });

  it("leaves a call whose arguments are not what they should be", () => {
    expect(callWords({ ...drive, input: { place: 7 } })).toBe("Drive to lab 2.3.7");
    expect(callWords({ ...drive, input: undefined })).toBe("Drive to lab 2.3.7");
  });

  it("knows a mode by what it does, not by its name alone", () => {
    const observe = { value: "observe", name: "Observe", description: OBSERVE };
    expect(modeWords(observe)).toMatchObject({ name: "Observar", value: "observe" });
    expect(modeWords(observe).description).toContain("nada se mueve");
    const other = { value: "plan", name: "Plan", description: "Writes a plan, then edits files." };
    expect(modeWords(other)).toEqual(other);
  });

  it("names what a call is given", () => {
    expect(argumentWords("plan_only")).toBe("solo calcular el camino");
    expect(argumentWords("wax_type")).toBe("wax type");
  });

  it("names modes and settings of the log", () => {
    expect(modeName("supervised")).toBe("Supervisado");
    expect(settingName("motion_asks", "Ask before driving")).toBe("Preguntar antes de moverse");
  });
});
