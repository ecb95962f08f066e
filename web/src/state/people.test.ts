/** Who is named first, and what a confirmation says before the robot is taken over. */
import { describe, expect, it } from "vitest";
import { parsePeople, type Person } from "../wire/people";
import { sortPeople, takeOverConsequences, waitingSession } from "./people";

const person = (name: string, role: Person["role"]): Person => ({ name, role, connections: 1, sessions: [] });
const SUE = { name: "Sue", role: "supervisor" } as const;
const HELD = { sessionId: "s1", by: "Ana", waiting: [] };
const BEN = { sessionId: "s2", by: "Ben" };
const OWN = { sessionId: "s3", by: "Sue" };

describe("the people of a message", () => {
  it("are read, with what cannot be read left out", () => {
    const people = [
      { name: "Ana", role: "operator", connections: 2, sessions: ["s1", 5] },
      { name: "Ben", role: "viewer" },
      { name: "Eve", role: "emperor", connections: 1, sessions: [] },
      { role: "viewer" },
      "nobody",
      null,
    ];
    expect(parsePeople({ people })).toEqual([
      { name: "Ana", role: "operator", connections: 2, sessions: ["s1"] },
      { name: "Ben", role: "viewer", connections: 1, sessions: [] },
    ]);
  });

  it.each([null, undefined, [], {}, { people: null }, { people: "all" }])("are none in %j", (params) => {
    expect(parsePeople(params)).toEqual([]);
  });
});

describe("the list", () => {
  const people = [
    person("Vic", "viewer"),
    person("Ben", "operator"),
    person("Ana", "operator"),
    person("Kiosk", "visitor"),
    person("Sue", "supervisor"),
  ];
  const names = (turn: Parameters<typeof sortPeople>[1]): string[] =>
    sortPeople(people, turn, SUE).map(({ name }) => name);

  it("has staff before visitors", () => {
    expect(names(null)).toEqual(["Sue", "Ana", "Ben", "Kiosk", "Vic"]);
  });

  it("has whoever has the robot first, and then those who wait for it", () => {
    const turn = { sessionId: "k", by: "Kiosk", waiting: [BEN] };
    expect(names(turn)).toEqual(["Kiosk", "Ben", "Sue", "Ana", "Vic"]);
    expect(sortPeople(people, turn, SUE).map(({ holding }) => holding)).toEqual([
      "has",
      "waits",
      null,
      null,
      null,
    ]);
  });

  it("knows who reads it, who is not somebody else of that name", () => {
    const both = [person("Sue", "visitor"), person("Sue", "supervisor")];
    expect(sortPeople(both, null, SUE).map(({ role, you }) => [role, you])).toEqual([
      ["supervisor", true],
      ["visitor", false],
    ]);
  });
});

describe("taking over", () => {
  it("lets the robot wait when nobody else does", () => {
    expect(takeOverConsequences(HELD, true, "Sue", null)).toEqual({
      ends: "endsDrive",
      holder: "Ana",
      then: "thenWaits",
      next: null,
    });
  });

  it("ends whatever it is that the other asked for", () => {
    expect(takeOverConsequences(HELD, false, "Sue", null).ends).toBe("endsRequest");
    expect(takeOverConsequences({ ...HELD, by: "Sue" }, true, "Sue", null).ends).toBe("endsOwn");
  });

  it("says that somebody else is next, where nobody here waits", () => {
    const told = takeOverConsequences({ ...HELD, waiting: [BEN, OWN] }, true, "Sue", null);
    expect([told.then, told.next]).toEqual(["thenTheirs", "Ben"]);
  });

  it("puts the session first for which it is done", () => {
    const line = { ...HELD, waiting: [BEN, OWN] };
    expect(takeOverConsequences(line, true, "Sue", "s3").then).toBe("thenYours");
    expect(takeOverConsequences(line, true, "Sue", "s2").then).toBe("thenTheirs");
    expect(takeOverConsequences(HELD, true, "Sue", "s3").then).toBe("thenYours");
  });

  it("is for the session of one's own that waits", () => {
    expect(waitingSession([BEN, OWN], "Sue")).toBe("s3");
    expect(waitingSession([BEN], "Sue")).toBeNull();
    expect(waitingSession(undefined, "Sue")).toBeNull();
  });
});
