/** What the list says of a session, what a search finds in it, and how it is read again. */
import type { SessionInfo } from "@agentclientprotocol/sdk";
import { describe, expect, it } from "vitest";
import { EMPTY } from "./conversation/conversation";
import { matchesSearch, mayDelete, mergeFirstPage, isWorking } from "./session-list";
import { META } from "../wire/meta";

const session = (sessionId: string, rest: Partial<SessionInfo> = {}): SessionInfo => ({
  sessionId,
  cwd: "/",
  ...rest,
});
const owned = (owner: string, title = "To lab 2"): SessionInfo =>
  session("s1", { title, _meta: { [META.owner]: owner } });

describe("a session works", () => {
  const running = session("s1", { _meta: { [META.turn]: { id: "t", state: "running" } } });

  it("when the list says so and nobody here watches it", () => {
    expect(isWorking(running, undefined, null)).toBe(true);
    expect(isWorking(session("s1"), undefined, null)).toBe(false);
  });

  it("when its turn has not ended before the eyes of this page, whatever an older list says", () => {
    expect(isWorking(running, EMPTY, null)).toBe(false);
    expect(isWorking(session("s1"), { ...EMPTY, turn: { id: "t", cancelling: false } }, null)).toBe(true);
  });

  it("when it has the robot", () => {
    expect(isWorking(session("s1"), undefined, "s1")).toBe(true);
    expect(isWorking(session("s1"), undefined, "s2")).toBe(false);
  });
});

describe("a session can be removed", () => {
  it.each([
    ["Ana", "operator", true],
    ["Ben", "operator", false],
    ["Ben", "supervisor", true],
  ] as const)("that is Ana's, by %s as %s: %s", (name, role, may) => {
    expect(mayDelete(owned("Ana"), { name, role })).toBe(may);
  });

  it("by whoever the agent lets, where it does not say whose it is", () => {
    expect(mayDelete(session("s1"), { name: "Ben", role: "operator" })).toBe(true);
  });
});

describe("a search", () => {
  it.each([
    ["", true],
    ["LAB to", true],
    ["ana lab", true],
    ["  ana ", true],
    ["lab 3", false],
    ["%", false],
  ])("for %j finds the session: %s", (words, found) => {
    expect(matchesSearch(owned("Ana"), words)).toBe(found);
  });

  it("finds a session without a title by its owner, and without either not at all", () => {
    expect(matchesSearch(session("s1", { _meta: { [META.owner]: "Ana" } }), "ana")).toBe(true);
    expect(matchesSearch(session("s1"), "ana")).toBe(false);
  });
});

describe("a first page that is read again", () => {
  const at = (sessionId: string, second: number): SessionInfo =>
    session(sessionId, { updatedAt: `2026-11-21T12:00:0${second}+00:00` });
  const ids = (sessions: SessionInfo[]): string[] => sessions.map(({ sessionId }) => sessionId);

  it("keeps the older ones below it", () => {
    const known = [at("d", 4), at("c", 3), at("b", 2), at("a", 1)];
    expect(ids(mergeFirstPage(known, [at("e", 5), at("d", 4)]))).toEqual(["e", "d", "c", "b", "a"]);
  });

  it("lets go of what is missing from it", () => {
    expect(ids(mergeFirstPage([at("d", 4), at("c", 3), at("a", 1)], [at("d", 4), at("b", 2)]))).toEqual([
      "d",
      "b",
      "a",
    ]);
    expect(mergeFirstPage([at("a", 1)], [])).toEqual([]);
  });

  it("has each session once", () => {
    expect(ids(mergeFirstPage([at("a", 1), at("b", 2)], [at("a", 5), at("b", 2)]))).toEqual(["a", "b"]);
  });
});
