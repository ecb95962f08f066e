/** The log of a session while somebody looks at it: it has no gap, and it stays small. */
import { beforeEach, expect, it, vi } from "vitest";
import { MAX_ROWS, type Row } from "../../state/log-rows";
import { EventLog } from "./event-log";
import type { EventPage, NumberedEvent } from "../../wire/event";
import { LogUnavailable } from "./event-pages";

const event = (seq: number): NumberedEvent => ({
  seq,
  at: seq,
  update: { sessionUpdate: "agent_message_chunk", content: { type: "text", text: `words ${seq}` } },
});
const events = (from: number, to: number): NumberedEvent[] =>
  Array.from({ length: to - from + 1 }, (_, index) => event(from + index));

let kept: NumberedEvent[];
let reads: number[];
const read = (after: number): Promise<EventPage> => {
  reads.push(after);
  const page = kept.filter(({ seq }) => seq > after).slice(0, 100);
  return Promise.resolve({ events: page, last: kept.length });
};
const numbers = (rows: readonly Row[]): number[] => rows.map(({ seq }) => seq);
const shows = (log: EventLog, upto: number): Promise<void> =>
  vi.waitFor(() => expect(numbers(log.getSnapshot().rows)).toEqual(events(1, upto).map(({ seq }) => seq)));

beforeEach(() => {
  kept = events(1, 250);
  reads = [];
});

it("is read to its end, page by page", async () => {
  const log = new EventLog(read);
  await log.catchUp();
  await shows(log, 250);
  expect(reads).toEqual([0, 100, 200]);
  expect(log.getSnapshot().status).toBe("ready");
});

it("goes on with what comes, and asks for nothing that came", async () => {
  const log = new EventLog(read);
  await log.catchUp();
  for (const more of events(251, 260)) log.receive(more);
  log.receive(event(255));
  await shows(log, 260);
  expect(reads).toHaveLength(3);
});

it("fetches what did not come, as one's own prompt", async () => {
  const log = new EventLog(read);
  await log.catchUp();
  kept = events(1, 252);
  log.receive(event(252));
  await shows(log, 252);
  expect(reads.at(-1)).toBe(250);
});

it("misses nothing that comes while it reads", async () => {
  const log = new EventLog((after) => {
    if (after === 200) {
      kept = events(1, 255);
      for (const more of events(251, 255)) log.receive(more);
    }
    return read(after);
  });
  await log.catchUp();
  await shows(log, 255);
});

it("waits for the connection, and says when an agent has no log", async () => {
  const lost = new EventLog(() => Promise.reject(new Error("lost")));
  await lost.catchUp();
  await vi.waitFor(() => expect(lost.getSnapshot().status).toBe("behind"));
  const none = new EventLog(() => Promise.reject(new LogUnavailable()));
  await none.catchUp();
  await vi.waitFor(() => expect(none.getSnapshot().status).toBe("unavailable"));
});

it("keeps the newest rows alone, however long the session is", async () => {
  kept = [];
  const log = new EventLog(read);
  await log.catchUp();
  for (const more of events(1, MAX_ROWS + 500)) log.receive(more);
  await vi.waitFor(() => expect(log.getSnapshot().rows.at(-1)?.seq).toBe(MAX_ROWS + 500));
  expect(log.getSnapshot().rows).toHaveLength(MAX_ROWS - 500);
  expect(log.getSnapshot().rows[0]?.seq).toBe(1001);
});
