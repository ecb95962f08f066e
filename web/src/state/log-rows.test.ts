/** The rows of the log: what they say, what is found, and that they are small. */
import type { SessionUpdate } from "@agentclientprotocol/sdk";
import { describe, expect, it } from "vitest";
import type { NumberedEvent } from "../wire/event";
import { FILTERS, fileName, filterRows, rowOf, type Filter, type Kind, type Titles } from "./log-rows";
import { META } from "../wire/meta";

const said = (text: string): SessionUpdate => ({
  sessionUpdate: "agent_message_chunk",
  content: { type: "text", text },
});
const event = (seq: number, update: SessionUpdate = said(`words ${seq}`)): NumberedEvent => ({
  seq,
  at: seq,
  update,
});

describe("a row", () => {
  const titles: Titles = new Map();
  const row = (update: SessionUpdate): [Kind, string] => {
    const { kind, text } = rowOf(event(1, update), titles);
    return [kind, text];
  };
  const call = { sessionUpdate: "tool_call_update" as const, toolCallId: "c" };
  const announced = { sessionUpdate: "tool_call" as const, toolCallId: "c", title: "Say hello" };

  it("says what happened, with the title of the call that it is about", () => {
    expect(
      row({
        sessionUpdate: "user_message_chunk",
        content: { type: "text", text: "go" },
        _meta: { [META.by]: "Ana" },
      }),
    ).toEqual(["asked", "Ana: go"]);
    expect(row({ ...announced, status: "pending" })).toEqual(["tool", "Say hello"]);
    expect(row({ ...call, status: "pending", _meta: { [META.waiting]: { for: "permission" } } })).toEqual([
      "question",
      "Say hello",
    ]);
    const decision = { by: "Ben", option: "allow_once", reason: "selected" };
    expect(row({ ...call, status: "in_progress", _meta: { [META.decision]: decision } })).toEqual([
      "allowed",
      "Ben: Say hello",
    ]);
    expect(
      row({
        ...call,
        status: "failed",
        _meta: { [META.decision]: { ...decision, option: "reject_once" } },
      }),
    ).toEqual(["refused", "Ben: Say hello"]);
    row(announced);
    expect(row({ ...call, status: "completed" })).toEqual(["done", "Say hello"]);
    expect(
      row({
        sessionUpdate: "session_info_update",
        _meta: { [META.turn]: { id: "t", state: "ended", stopReason: "end_turn" } },
      }),
    ).toEqual(["ended", "end_turn"]);
  });

  it("knows which of its words are not the page's", () => {
    const others = (update: SessionUpdate): string => {
      const { text, foreignFrom } = rowOf(event(1, update), titles);
      return text.slice(foreignFrom);
    };
    expect(others({ ...said("go  on"), _meta: { [META.by]: "Ana" } })).toBe("go on");
    const asked = { ...said("go"), sessionUpdate: "user_message_chunk" } as SessionUpdate;
    expect(others({ ...asked, _meta: { [META.by]: "Ana  B." } })).toBe("go");
    expect(others(announced)).toBe("Say hello");
    const drive = { title: "Drive to lab 1", rawInput: { place: "lab 1" } };
    expect(others({ ...announced, ...drive, _meta: { [META.tool]: "navigate_to_place" } })).toBe("");
    const wall = { type: "content" as const, content: { type: "text" as const, text: "In a wall." } };
    expect(others({ ...call, status: "failed", content: [wall] })).toBe("In a wall.");
    expect(others({ sessionUpdate: "session_info_update", title: "Tour" })).toBe("Tour");
  });

  it("of a call that has ended leaves nothing behind, however it ended", () => {
    const decision = { by: "Ben", option: "reject_once", reason: "selected" };
    row(announced);
    row({ ...call, status: "completed" });
    row(announced);
    row({ ...call, status: "failed" });
    row(announced);
    row({ ...call, status: "failed", _meta: { [META.decision]: decision } });
    expect(titles.size).toBe(0);
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
    filterRows(rows, new Set(kinds), words, (kind) => (kind === "said" ? "Answered" : "Thought")).map(
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
