/** The field sends when it should, says why when it cannot, and never loses what was written. */
import { fireEvent, render, screen, waitFor } from "@testing-library/react";
import { beforeEach, describe, expect, it, vi } from "vitest";
import * as sessions from "../../acp/sessions/sessions";
import { EMPTY } from "../../state/conversation/conversation";
import { INITIAL, setState, type State } from "../../state/store";
import { Composer } from "./composer";
import { useComposerText } from "./composer-text";
import type { Role } from "../../wire/bridge";

function show(state: Partial<State> = {}, role: Role = "supervisor"): void {
  setState({
    ...INITIAL,
    currentId: "s1",
    attached: new Set(["s1"]),
    conversations: { s1: EMPTY },
    link: { status: "online" },
    auth: { status: "in", me: { name: "Ana", role, robot: "Sancho" } },
    ...state,
  });
  render(<Composer />);
}

const field = (): HTMLTextAreaElement => screen.getByTestId("composer");
const write = (text: string): void => void fireEvent.change(field(), { target: { value: text } });
const running = { conversations: { s1: { ...EMPTY, turn: { id: "t1", cancelling: false } } } };

beforeEach(() => {
  useComposerText.setState({ text: "" });
  vi.spyOn(sessions, "prompt").mockResolvedValue(true);
  vi.spyOn(sessions, "cancelTurn").mockResolvedValue();
});

describe("the field", () => {
  it("sends with Enter and is empty then", () => {
    show();
    write("  go to the kitchen ");
    fireEvent.keyDown(field(), { key: "Enter" });
    expect(sessions.prompt).toHaveBeenCalledExactlyOnceWith("go to the kitchen", "Ana");
    expect(field().value).toBe("");
  });

  it("has the text again when it did not arrive, before what was written since", async () => {
    let lose: (arrived: boolean) => void = () => undefined;
    vi.mocked(sessions.prompt).mockReturnValue(new Promise((settle) => (lose = settle)));
    show();
    write("go to the kitchen");
    fireEvent.keyDown(field(), { key: "Enter" });
    write("and wait");
    lose(false);
    await waitFor(() => expect(field().value).toBe("go to the kitchen\nand wait"));
  });

  it("begins a new line with Shift and Enter, and does nothing on Escape", () => {
    show();
    write("go");
    fireEvent.keyDown(field(), { key: "Enter", shiftKey: true });
    fireEvent.keyDown(field(), { key: "Escape" });
    expect(sessions.prompt).not.toHaveBeenCalled();
    expect(field().value).toBe("go");
  });

  it("sends nothing that is empty", () => {
    show();
    write("   ");
    fireEvent.keyDown(field(), { key: "Enter" });
    expect(sessions.prompt).not.toHaveBeenCalled();
  });

  it("keeps the text while a turn runs", () => {
    show(running);
    write("and then?");
    fireEvent.keyDown(field(), { key: "Enter" });
    expect(sessions.prompt).not.toHaveBeenCalled();
    expect(field().value).toBe("and then?");
    expect(screen.getByText(/when it has finished/)).toBeDefined();
  });

  it("is off without a connection, and says so", () => {
    show({ link: { status: "waiting", retryAt: 0 } });
    expect(field().disabled).toBe(true);
    expect(screen.getByText(/Not connected/)).toBeDefined();
  });

  it("is off for a viewer, and says so", () => {
    show({}, "viewer");
    expect(field().disabled).toBe(true);
    expect(screen.getByText(/as a viewer/)).toBeDefined();
  });
});

describe("cancel", () => {
  it("is there only while a turn runs", () => {
    show();
    expect(screen.queryByTestId("cancel")).toBeNull();
  });

  it("cancels the turn", () => {
    show(running);
    fireEvent.click(screen.getByTestId("cancel"));
    expect(sessions.cancelTurn).toHaveBeenCalledOnce();
  });

  it("says that it is stopping until the turn has ended", () => {
    show({ conversations: { s1: { ...EMPTY, turn: { id: "t1", cancelling: true } } } });
    const cancel = screen.getByTestId<HTMLButtonElement>("cancel");
    expect(cancel.textContent).toContain("Stopping");
    expect(cancel.disabled).toBe(true);
  });
});
