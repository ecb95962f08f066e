/** What a step shows of a robot that nobody hears any more: nothing of how far it is, for nobody knows. */
import { act, render, screen } from "@testing-library/react";
import { beforeEach, expect, it, vi } from "vitest";
import { EMPTY, type ToolItem } from "../../state/conversation/conversation";
import { INITIAL, setState } from "../../state/store";
import { ConversationLog } from "./conversation-log";

const DRIVING: ToolItem = {
  kind: "tool",
  key: "1",
  id: "c1",
  title: "Drive to the kitchen",
  tool: "navigate_to_place",
  status: "in_progress",
  content: [],
  input: { place: "the kitchen" },
  output: null,
  progress: { fraction: 0.5, message: "12.4 m to go, about 21 s" },
  waiting: null,
  decision: null,
};

class NoObserver {
  observe = (): void => undefined;
  disconnect = (): void => undefined;
}

beforeEach(() => {
  vi.stubGlobal("ResizeObserver", NoObserver);
  setState({
    ...INITIAL,
    link: { status: "online" },
    auth: { status: "in", me: { name: "Ana", role: "operator", robot: "Sancho" } },
    currentId: "s1",
    conversations: { s1: { ...EMPTY, items: [DRIVING], turn: { id: "t1", cancelling: false } } },
  });
  render(<ConversationLog />);
});

const card = (): HTMLElement => screen.getByTestId("tool-card");

it("is how far it is, while the robot is heard", () => {
  expect(screen.getByRole("progressbar").getAttribute("aria-valuenow")).toBe("50");
  expect(card().textContent).toContain("12.4 m to go");
  expect(card().textContent).toContain("under way");
  expect(screen.getByText("Sancho is at work …")).toBeDefined();
});

it("is only that it was under way, once nothing is heard", () => {
  act(() => setState({ silentSince: 7 }));
  expect(screen.queryByRole("progressbar")).toBeNull();
  expect(card().textContent).not.toContain("12.4 m");
  expect(card().textContent).toContain("was under way");
  expect(screen.queryByText("Sancho is at work …")).toBeNull();
  act(() => setState({ silentSince: null }));
  expect(screen.getByRole("progressbar")).toBeDefined();
});
