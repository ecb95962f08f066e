/** The log of a session while somebody looks at it: it has no gap, and it stays small. */
import { beforeEach, expect, it, vi } from "vitest";
import { MOST, type Row } from "../../state/log-rows";
import { EventLog } from "./event-log";
import type { Event } from "./event-feed";
import { NoLog, type Page } from "./event-pages";

const event = (seq: number): Event => ({
  seq,
  at: seq,
  update: { sessionUpdate: "agent_message_chunk", content: { type: "text", text: `words ${seq}` } },
});
const events = (from: number, to: number): Event[] =>
  Array.from({ length: to - from + 1 }, (_, index) => event(from + index));

let kept: Event[];
let reads: number[];
const read = (after: number): Promise<Page> => {
  reads.push(after);
  const page = kept.filter(({ seq }) => seq > after).slice(0, 100);
  return Promise.resolve({ events: page, last: kept.length });
};
const numbers = (rows: readonly Row[]): number[] => rows.map(({ seq }) => seq);
const shows = (log: EventLog, upto: number): Promise<void> =>
  vi.waitFor(() => expect(numbers(log.get().rows)).toEqual(events(1, upto).map(({ seq }) => seq)));

beforeEach(() => {
  kept = events(1, 250);
  reads = [];
});

it("is read to its end, page by page", async () => {
  const log = new EventLog(read);
  await log.catchUp();
  await shows(log, 250);
  expect(reads).toEqual([0, 100, 200]);
  expect(log.get().standing).toBe("ready");
});

it("goes on with what comes, and asks for nothing that came", async () => {
  const log = new EventLog(read);
  await log.catchUp();
  for (const more of events(251, 260)) log.take(more);
  log.take(event(255));
  await shows(log, 260);
  expect(reads).toHaveLength(3);
});

it("fetches what did not come, as one's own prompt", async () => {
  const log = new EventLog(read);
  await log.catchUp();
  kept = events(1, 252);
  log.take(event(252));
  await shows(log, 252);
  expect(reads.at(-1)).toBe(250);
});

it("misses nothing that comes while it reads", async () => {
  const log = new EventLog((after) => {
    if (after === 200) {
      kept = events(1, 255);
      for (const more of events(251, 255)) log.take(more);
    }
    return read(after);
  });
  await log.catchUp();
  await shows(log, 255);
});

it("waits for the connection, and says when an agent has no log", async () => {
  const lost = new EventLog(() => Promise.reject(new Error("lost")));
  await lost.catchUp();
  await vi.waitFor(() => expect(lost.get().standing).toBe("behind"));
  const none = new EventLog(() => Promise.reject(new NoLog()));
  await none.catchUp();
  await vi.waitFor(() => expect(none.get().standing).toBe("none"));
});

it("keeps the newest rows alone, however long the session is", async () => {
  kept = [];
  const log = new EventLog(read);
  await log.catchUp();
  for (const more of events(1, MOST + 500)) log.take(more);
  await vi.waitFor(() => expect(log.get().rows.at(-1)?.seq).toBe(MOST + 500));
  expect(log.get().rows).toHaveLength(MOST - 500);
  expect(log.get().rows[0]?.seq).toBe(1001);
});
