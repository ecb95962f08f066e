/** A step that was not completed when its turn ended is not shown as done, and not as under way either. */
import { render, screen } from "@testing-library/react";
import { expect, it } from "vitest";
import { EMPTY, type PlanItem } from "../../state/conversation/conversation";
import { sessionReducer } from "../../state/conversation/reducer";
import { META } from "../../wire/meta";
import { PlanCard } from "./plan-card";

const ENTRIES = (["completed", "in_progress", "pending"] as const).map((status) => ({
  content: `step ${status}`,
  status,
  priority: "medium" as const,
}));

it("says so of each step", () => {
  const planned = sessionReducer(EMPTY, {
    sessionId: "s1",
    update: { sessionUpdate: "plan", entries: ENTRIES },
  });
  const marks = (state: typeof planned): (string | undefined)[] => {
    render(<PlanCard item={state.items[0] as PlanItem} />);
    const steps = screen.getAllByRole("listitem").map(({ dataset }) => dataset["status"]);
    document.body.innerHTML = "";
    return steps;
  };
  expect(marks(planned)).toEqual(["completed", "in_progress", "pending"]);
  const ended = sessionReducer(planned, {
    sessionId: "s1",
    update: {
      sessionUpdate: "session_info_update",
      _meta: { [META.turn]: { id: "t", state: "ended", stopReason: "end_turn" } },
    },
  });
  expect(marks(ended)).toEqual(["completed", "failed", "failed"]);
});
