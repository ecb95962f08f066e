/** The timeline is a clock only while somebody knows that the turn runs. */
import { act, render, screen } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { EMPTY } from "../../state/conversation/conversation";
import { INITIAL, setState } from "../../state/store";
import { startTimeline } from "../../state/conversation/timeline";
import { TurnView } from "./turn-view";

const total = (): number => Number(screen.getByTestId("phase-total").dataset["seconds"]);
const later = (ms: number): void => act(() => void vi.advanceTimersByTime(ms));

beforeEach(() => {
  vi.useFakeTimers({ now: 100_000 });
  const conversation = { ...EMPTY, timeline: startTimeline(90, "t1") };
  setState({ ...INITIAL, currentId: "s1", conversations: { s1: conversation } });
});

afterEach(() => vi.useRealTimers());

it("grows while the turn runs, stands still while nobody knows, and goes on when the robot is heard again", () => {
  render(<TurnView />);
  later(2000);
  expect(total()).toBeCloseTo(12);
  act(() => setState({ silentSince: 101 }));
  later(60_000);
  expect(total()).toBeCloseTo(11);
  expect(screen.getByText("This turn, until nothing was heard any more")).toBeDefined();
  act(() => setState({ silentSince: null }));
  later(1000);
  expect(total()).toBeCloseTo(73);
});
