/** A search belongs to the words that are in the field when its answer comes. */
import type { ClientContext } from "@agentclientprotocol/sdk";
import { afterEach, beforeEach, expect, it } from "vitest";
import { INITIAL, getState, setState } from "../../state/store";
import { loadMoreResults, searchSessions } from "./search";
import { setAgent } from "../connection/agent";
import { META } from "../../wire/meta";

let asked: { params: unknown; answer: (page: unknown) => void }[];

beforeEach(() => {
  asked = [];
  setState(INITIAL);
  const request = (_method: string, params: unknown): Promise<unknown> =>
    new Promise((answer) => asked.push({ params, answer }));
  setAgent({ request } as unknown as ClientContext);
});

afterEach(() => setAgent(null));

const page = (id: string, nextCursor?: string): unknown => ({
  sessions: [{ sessionId: id, cwd: "/" }],
  ...(nextCursor === undefined ? {} : { nextCursor }),
});

const found = (): string[] | undefined => getState().found?.sessions.map(({ sessionId }) => sessionId);

it("shows what the agent finds", async () => {
  const search = searchSessions("  Lab   ANA ");
  expect(asked[0]?.params).toEqual({ _meta: { [META.search]: "lab ana" } });
  asked[0]?.answer(page("s1"));
  await search;
  expect(getState().found?.words).toBe("lab ana");
  expect(found()).toEqual(["s1"]);
});

it("drops an answer to what nobody looks for any more", async () => {
  const first = searchSessions("la");
  const second = searchSessions("lab");
  asked[1]?.answer(page("new"));
  await second;
  asked[0]?.answer(page("old"));
  await first;
  expect(found()).toEqual(["new"]);
});

it("finds nothing more once the field is empty", async () => {
  const search = searchSessions("lab");
  await searchSessions(" ");
  asked[0]?.answer(page("late"));
  await search;
  expect(getState().found).toBeNull();
});

it("goes on to the next page of the same words", async () => {
  const search = searchSessions("lab");
  asked[0]?.answer(page("s1", "next"));
  await search;
  const more = loadMoreResults();
  expect(asked[1]?.params).toEqual({ cursor: "next", _meta: { [META.search]: "lab" } });
  asked[1]?.answer(page("s2"));
  await more;
  expect(found()).toEqual(["s1", "s2"]);
  expect(getState().found?.more).toBeNull();
});
