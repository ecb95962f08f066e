/** Going somewhere is an ordinary prompt, sent by an act of its own and only when it can be. */
import { fireEvent, render, screen } from "@testing-library/react";
import { beforeEach, expect, it, vi } from "vitest";
import * as sessions from "../../acp/sessions/sessions";
import type { Destination } from "../../scene/destination";
import { EMPTY } from "../../state/conversation/conversation";
import { INITIAL, setState, type State } from "../../state/store";
import { GoHere } from "./go-here";

const onDone = vi.fn();
const onDestination = vi.fn();

function show(destination: Destination | null, state: Partial<State> = {}): void {
  setState({
    ...INITIAL,
    currentId: "s1",
    attached: new Set(["s1"]),
    conversations: { s1: EMPTY },
    link: { status: "online" },
    auth: { status: "in", me: { name: "Ana", role: "operator", robot: "Sancho" } },
    abilities: { places: ["lab 10", "lab 2"].map((name) => ({ name, type: null })), tools: [], titles: {} },
    ...state,
  });
  render(<GoHere destination={destination} refused={null} onDestination={onDestination} onDone={onDone} />);
}

const go = (): HTMLButtonElement => screen.getByTestId("go-here-go");
const list = (): HTMLSelectElement => screen.getByTestId("go-here-place");

beforeEach(() => {
  vi.stubGlobal("matchMedia", () => ({ matches: false }));
  vi.clearAllMocks();
  vi.spyOn(sessions, "prompt").mockResolvedValue(true);
});

it("says what to do, and goes nowhere before somebody has chosen", () => {
  show(null);
  expect(list().selectedOptions[0]?.textContent).toBe("Click a place or the floor …");
  expect(go().disabled).toBe(true);
});

it("offers the places in the order in which people count", () => {
  show(null);
  expect([...list().options].slice(1).map(({ textContent }) => textContent)).toEqual([
    "Go to lab 2",
    "Go to lab 10",
  ]);
  fireEvent.change(list(), { target: { value: "lab 2" } });
  expect(onDestination).toHaveBeenCalledExactlyOnceWith({ place: "lab 2" });
});

it.each([
  [{ place: "lab 2" }, "Go to lab 2", "Go to lab 2"],
  [{ place: "the new lab" }, "Go to the new lab", "Go to the new lab"],
  [{ x: 12.34, y: 4.5 }, "Go to the point 12.3, 4.5", "Go to the point x 12.3, y 4.5"],
])("sends %j as a prompt of the person here", (destination, shown, prompt) => {
  show(destination);
  expect(list().selectedOptions[0]?.textContent).toBe(shown);
  fireEvent.click(go());
  expect(sessions.prompt).toHaveBeenCalledExactlyOnceWith(prompt, "Ana");
  expect(onDone).toHaveBeenCalledExactlyOnceWith(shown);
});

it("waits while a turn runs, and says so", () => {
  show({ place: "lab 2" }, { conversations: { s1: { ...EMPTY, turn: { id: "t1", cancelling: false } } } });
  expect(go().disabled).toBe(true);
  fireEvent.submit(screen.getByTestId("go-here-bar"));
  expect(sessions.prompt).not.toHaveBeenCalled();
  expect(screen.getByText(/when it has finished/)).toBeDefined();
});

it("says that there is no session", () => {
  show({ place: "lab 2" }, { currentId: null });
  expect(go().disabled).toBe(true);
  expect(screen.getByText(/No session is open/)).toBeDefined();
});

it("is given up with Escape", () => {
  show({ place: "lab 2" });
  fireEvent.keyDown(list(), { key: "Escape" });
  expect(onDone).toHaveBeenCalledExactlyOnceWith(null);
  expect(sessions.prompt).not.toHaveBeenCalled();
});
