/** Nothing that happens is hidden from whoever decides, and nothing is said twice. */
import { afterEach, expect, it } from "vitest";
import i18next from "../../i18n";
import { remainingArguments } from "./remaining-arguments";

it.each([
  ["Drive to lab 2.3.7", { place: "lab 2.3.7" }, []],
  ["Drive to (4.2, 3.0)", { x: 4.2, y: 3 }, []],
  ["Drive to (4.2, 3.0)", { x: 4.2, y: 3, yaw: 1.57 }, ["yaw"]],
  ["Say aloud: “The meeting is at noon.”", { text: "The meeting is at noon." }, []],
  ["lab: Pour: amount 1, cup 2", { amount: 1, cup: 2 }, []],
  ["Turn by 30°", { degrees: 3 }, ["degrees"]],
  ["Turn by -30°", { degrees: 30 }, ["degrees"]],
  ["Turn by 3.5°", { degrees: 3 }, ["degrees"]],
  ["Turn by 3°", { degrees: 3, times: 3 }, ["times"]],
  ["Open", { door: { id: 7 }, loud: true, name: null }, ["door", "loud"]],
  ["Say: 5", { text: "5 is 5", loudness: 5 }, ["text"]],
  ["Open", "not an object", []],
])("%s with %j leaves %j to be told", (title, input, left) => {
  expect(Object.keys(remainingArguments({ tool: null, input, title }))).toEqual(left);
});

afterEach(async () => {
  await i18next.changeLanguage("en");
});

it.each(["en", "es"])("takes no word of ours for an argument: %s", async (language) => {
  await i18next.changeLanguage(language);
  const speak = { text: "Hello.", how: "alta", voice: "voz", to: "a", style: "Say", volume: "aloud" };
  const said = remainingArguments({ tool: "speak", input: speak, title: "Say aloud: “Hello.”" });
  expect(Object.keys(said)).toEqual(["how", "voice", "to", "style", "volume"]);
  const drive = { x: 4.2, y: 3, yaw: 1.57 };
  const driven = remainingArguments({ tool: "navigate_to_pose", input: drive, title: "Drive to (4.2, 3.0)" });
  expect(Object.keys(driven)).toEqual(["yaw"]);
});

it("takes the title that came for what it says where it is not ours", () => {
  const send = { tool: "speak", input: { text: "Hello.", to: "Ana" }, title: "Send “Hello.”" };
  expect(Object.keys(remainingArguments(send))).toEqual(["to"]);
});
