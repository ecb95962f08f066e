/** What is known is said in the reader's language; what is not, or only looks like it, stays as it came. */
import { afterEach, beforeEach, describe, expect, it } from "vitest";
import i18next from ".";
import { argumentName, callText, modeName, translateMode, settingName, toolText } from "./agent-terms";

const drive = { tool: "navigate_to_place", input: { place: "lab 2.3.7" }, title: "Drive to lab 2.3.7" };
const OBSERVE = "Looks and answers; nothing moves, nothing is said aloud.";

describe("in English", () => {
  it("says what the robot's own titles say", () => {
    expect(callText(drive)).toBe("Drive to lab 2.3.7");
    expect(toolText("speak", "Say something aloud")).toBe("Say something aloud");
  });

  it("never gives a call of another robot's the name of one of ours", () => {
    const send = { tool: "speak", input: { text: "hi" }, title: "Send as a message: “hi”" };
    expect(callText(send)).toBe("Send as a message: “hi”");
    expect(callText({ ...drive, title: "Drive to lab 2.3.9" })).toBe("Drive to lab 2.3.9");
    expect(toolText("speak", "Send as a message")).toBe("Send as a message");
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
    expect(callText(drive)).toBe("Ir a lab 2.3.7");
    const said = "Costs $t(mode.plan) and {{text}} & <b>";
    expect(callText({ tool: "speak", input: { text: said }, title: `Say aloud: “${said}”` })).toBe(
      `Decir en voz alta: «${said}»`,
    );
    expect(toolText("speak", "Say something aloud")).toBe("Decir algo en voz alta");
  });

  it.each(["Drive to (4.25, -3)", "Drive to (4.25, -3.0)"])(
    "reads a number as Python writes it: %s",
    (title) => {
      const call = { tool: "navigate_to_pose", input: { x: 4.25, y: -3 }, title };
      expect(callText(call)).toBe("Ir a (4.25; -3)");
    },
  );

  it("leaves a call whose title says something else", () => {
    expect(callText({ ...drive, title: "Drive to lab 2.3.7 and back" })).toBe("Drive to lab 2.3.7 and back");
    expect(toolText("speak", "Send as a message")).toBe("Send as a message");
  });

  it("leaves what is not known as it came", () => {
    expect(callText({ tool: "polish_floor", input: {}, title: "Polish the floor" })).toBe("Polish the floor");
    expect(callText({ tool: "guest__speak", input: { text: "hi" }, title: "guest: Speak" })).toBe(
      "guest: Speak",
    );
    expect(callText({ tool: "constructor", input: {}, title: "Build" })).toBe("Build");
    expect(callText({ ...drive, tool: null })).toBe("Drive to lab 2.3.7");
    expect(toolText("polish_floor", "Polish the floor")).toBe("Polish the floor");
    expect(modeName("plan-mode")).toBe("plan-mode");
    expect(settingName("temperature", "Temperature")).toBe("Temperature");
  });

  it("leaves a call whose arguments are not what they should be", () => {
    expect(callText({ ...drive, input: { place: 7 } })).toBe("Drive to lab 2.3.7");
    expect(callText({ ...drive, input: undefined })).toBe("Drive to lab 2.3.7");
  });

  it("knows a mode by what it does, not by its name alone", () => {
    const observe = { value: "observe", name: "Observe", description: OBSERVE };
    expect(translateMode(observe)).toMatchObject({ name: "Observar", value: "observe" });
    expect(translateMode(observe).description).toContain("nada se mueve");
    const other = { value: "plan", name: "Plan", description: "Writes a plan, then edits files." };
    expect(translateMode(other)).toEqual(other);
  });

  it("names what a call is given", () => {
    expect(argumentName("plan_only")).toBe("solo calcular el camino");
    expect(argumentName("wax_type")).toBe("wax type");
  });

  it("names modes and settings of the log", () => {
    expect(modeName("supervised")).toBe("Supervisado");
    expect(settingName("motion_asks", "Ask before driving")).toBe("Preguntar antes de moverse");
  });
});
