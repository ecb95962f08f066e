/** The log: what its rows say, what is found in it, that it has no gap, and that it stays small. */
import type { SessionUpdate } from "@agentclientprotocol/sdk";
import { beforeEach, describe, expect, it, vi } from "vitest";
import type { Event } from "../acp/events";
import { NoLog, type Page } from "../acp/log-pages";
import { EventLog } from "./event-log";
import { FILTERS, fileName, matching, MOST, rowOf, type Filter, type Kind, type Row } from "./log";

const said = (text: string): SessionUpdate => ({
  sessionUpdate: "agent_message_chunk",
  content: { type: "text", text },
});
const event = (seq: number, update: SessionUpdate = said(`words ${seq}`)): Event => ({
  seq,
  at: seq,
  update,
});
const events = (from: number, to: number): Event[] =>
  Array.from({ length: to - from + 1 }, (_, index) => event(from + index));

describe("a row", () => {
  const titles = new Map<string, string>();
  const row = (update: SessionUpdate): [Kind, string] => {
    const { kind, text } = rowOf(event(1, update), titles);
    return [kind, text];
  };
  const call = { sessionUpdate: "tool_call_update" as const, toolCallId: "c" };

  it("says what happened, with the title of the call that it is about", () => {
    expect(
      row({
        sessionUpdate: "user_message_chunk",
        content: { type: "text", text: "go" },
        _meta: { "robot-acp/by": "Ana" },
      }),
    ).toEqual(["asked", "Ana: go"]);
    expect(
      row({ sessionUpdate: "tool_call", toolCallId: "c", title: "Say hello", status: "pending" }),
    ).toEqual(["tool", "Say hello"]);
    expect(
      row({ ...call, status: "pending", _meta: { "robot-acp/waiting": { for: "permission" } } }),
    ).toEqual(["question", "Say hello"]);
    const decision = { by: "Ben", option: "allow_once", reason: "selected" };
    expect(row({ ...call, status: "in_progress", _meta: { "robot-acp/decision": decision } })).toEqual([
      "allowed",
      "Ben: Say hello",
    ]);
    expect(
      row({
        ...call,
        status: "failed",
        _meta: { "robot-acp/decision": { ...decision, option: "reject_once" } },
      }),
    ).toEqual(["refused", "Ben: Say hello"]);
    expect(row({ ...call, status: "completed" })).toEqual(["done", "Say hello"]);
    expect(
      row({
        sessionUpdate: "session_info_update",
        _meta: { "robot-acp/turn": { id: "t", state: "ended", stopReason: "end_turn" } },
      }),
    ).toEqual(["ended", "end turn"]);
  });

  it("is small, whatever its event holds", () => {
    expect(row(said("x".repeat(1_000_000)))[1]).toHaveLength(200);
    const picture = { type: "image" as const, data: "A".repeat(1_000_000), mimeType: "image/png" };
    expect(row({ sessionUpdate: "agent_message_chunk", content: picture })).toEqual(["said", "[image]"]);
  });
});

it("finds by kind and by words, in any order", () => {
  const rows = [
    rowOf(event(1, said("The meeting is at noon")), new Map()),
    rowOf(
      event(2, { ...said("I look it up at noon"), sessionUpdate: "agent_thought_chunk" } as SessionUpdate),
      new Map(),
    ),
  ];
  const found = (kinds: Filter[], words: string): number[] =>
    matching(rows, new Set(kinds), words, (kind) => (kind === "said" ? "Answered" : "Thought")).map(
      ({ seq }) => seq,
    );
  const all = [...FILTERS];
  expect(found(all, "")).toEqual([1, 2]);
  expect(found(["thoughts"], "")).toEqual([2]);
  expect(found(all, "NOON meeting")).toEqual([1]);
  expect(found(all, "answered")).toEqual([1]);
  expect(found([], "")).toEqual([]);
});

it("names the file so that every system takes it", () => {
  const day = new Date(2026, 10, 5);
  expect(fileName("Sancho", "Go to lab 2.3.7 – ¡rápido!", "abc", day)).toBe(
    "sancho-2026-11-05-go-to-lab-2-3-7-rapido.jsonl",
  );
  expect(fileName("机器人", null, "0123456789ab", day)).toBe("2026-11-05-01234567.jsonl");
});

describe("the log of a session", () => {
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
    expect(log.get().rows).toHaveLength(MOST);
    expect(log.get().rows[0]?.seq).toBe(501);
  });
});
