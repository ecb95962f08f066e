/** What a kiosk suggests. */
import { describe, expect, it } from "vitest";
import { parseAbilities, type Abilities } from "../../wire/abilities";
import { suggestions } from "./suggestions";

const ALL = ["navigate_to_place", "take_photo", "speak", "get_current_pose", "get_robot_status"];
const room = (name: string): Abilities["places"][number] => ({ name, type: "space" });

describe("the suggestions", () => {
  it("are places with names that mean something, one with a number, and what the robot can do", () => {
    const places = [
      { name: "dock", type: "docking" },
      ...["reception", "kitchen", "corridor", "lab 2.3.1", "lab 2.3.2"].map(room),
    ];
    expect(suggestions({ places, tools: ALL })).toEqual([
      { key: "toThe", place: "reception" },
      { key: "toThe", place: "kitchen" },
      { key: "to", place: "lab 2.3.1" },
      { key: "see" },
      { key: "sayHello" },
      { key: "where" },
    ]);
  });

  it("name no place where the robot cannot drive to one, and nothing that it cannot do", () => {
    const offered = suggestions({ places: [room("kitchen")], tools: ["take_photo"] });
    expect(offered).toEqual([{ key: "see" }, { key: "abilities" }]);
  });

  it("are four at least for a robot with few places", () => {
    expect(suggestions({ places: [], tools: ALL }).map(({ key }) => key)).toEqual([
      "see",
      "sayHello",
      "where",
      "battery",
    ]);
  });
});

describe("the abilities", () => {
  it("that make no sense are none", () => {
    for (const wrong of [null, 7, [], {}, { places: "x", tools: [1, null] }, { places: [{ name: 5 }] }]) {
      expect(parseAbilities(wrong)).toEqual({ places: [], tools: [], titles: {} });
    }
  });

  it("are read one by one", () => {
    const told = {
      places: [{ name: "kitchen" }, 3, room("lab")],
      tools: [{ name: "speak", title: "Say it" }, {}],
    };
    expect(parseAbilities(told)).toEqual({
      places: [{ name: "kitchen", type: null }, room("lab")],
      tools: ["speak"],
      titles: { speak: "Say it" },
    });
  });
});
