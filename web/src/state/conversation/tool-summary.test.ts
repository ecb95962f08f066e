/** What people read of a tool call: sentences, never data. */
import { describe, expect, it } from "vitest";
import type { ToolItem } from "./conversation";
import { outcomeOf, summaryOf } from "./tool-summary";

function item(fields: Partial<ToolItem>, text?: string): ToolItem {
  return {
    kind: "tool",
    key: "i1",
    id: "c1",
    title: "Drive to lab 2.3.7",
    tool: null,
    status: "completed",
    content: text === undefined ? [] : [{ type: "content", content: { type: "text", text } }],
    input: {},
    output: undefined,
    progress: null,
    waiting: null,
    decision: null,
    ...fields,
  };
}

const summary = (tool: ToolItem): string => summaryOf(tool, outcomeOf(tool, false)).text;

describe("the outcome of a tool call", () => {
  it("is a refusal when a reject option was selected", () => {
    const decision = { by: "Ana", option: "reject_once", reason: "selected" };
    expect(outcomeOf(item({ status: "failed", decision }), false)).toBe("refused");
  });

  it.each(["timeout", "nobody"])("is a refusal when the reason is %s", (reason) => {
    expect(outcomeOf(item({ status: "failed", decision: { by: null, option: null, reason } }), false)).toBe(
      "refused",
    );
  });

  it("is a failure when it was allowed and did not work", () => {
    const decision = { by: "Ana", option: "allow_once", reason: "selected" };
    expect(outcomeOf(item({ status: "failed", decision }), false)).toBe("failed");
  });

  it("is a cancellation when the agent says so", () => {
    expect(outcomeOf(item({ status: "failed" }, "cancelled"), false)).toBe("cancelled");
  });

  it("waits for an answer while a question is open", () => {
    expect(outcomeOf(item({ status: "pending" }), true)).toBe("asking");
    expect(outcomeOf(item({ status: "pending" }), false)).toBe("pending");
  });
});

describe("the summary of a tool call", () => {
  it("of a drive tells time and way", () => {
    const output = { reached: true, duration_s: 28.2, distance: 15.68, path_length: 15.6 };
    expect(summary(item({ tool: "navigate_to_place", output }))).toBe("Arrived after 28 s, 15.7 m driven.");
  });

  it("of a plan says that nothing has moved", () => {
    const output = { reached: false, duration_s: 0, distance: 0, path_length: 15.6 };
    expect(summary(item({ tool: "navigate_to_place", output }))).toBe(
      "The way is 15.6 m long. Nothing has moved.",
    );
  });

  it("of a failure is the sentence without the code for programs", () => {
    const failed = item({ status: "failed" }, "occupied: The goal (3.2, 1.0) is inside a wall.");
    expect(summary(failed)).toBe("The goal (3.2, 1.0) is inside a wall.");
  });

  it("never is JSON", () => {
    expect(summary(item({ tool: "something_else", output: { a: 1 } }, '{"a": 1}'))).toBe("");
    expect(summary(item({ tool: "something_else" }, "It rains."))).toBe("It rains.");
  });

  it("of speech without a voice says that nobody heard it", () => {
    expect(summary(item({ tool: "speak", output: { audible: false } }))).toContain("nobody heard");
  });
});
