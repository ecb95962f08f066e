/** Allowing takes an act of will. */
import type { RequestPermissionResponse } from "@agentclientprotocol/sdk";
import { act, cleanup, fireEvent, render, screen } from "@testing-library/react";
import { beforeEach, describe, expect, it, vi, type MockInstance } from "vitest";
import { INITIAL, setState, type Question } from "../../state/store";
import { QuestionCard } from "./question-card";

/** jsdom lays nothing out, so there is nothing to observe. */
class Observer {
  observe = vi.fn();
  unobserve = vi.fn();
  disconnect = vi.fn();
}

let inFront: MockInstance<() => boolean>;
const answers: RequestPermissionResponse[] = [];

const QUESTION: Question = {
  key: "q1",
  sessionId: "s1",
  toolCallId: "c3",
  tool: "speak",
  title: "Say aloud: “The meeting is at noon.”",
  asker: "Ana",
  subject: "Say something aloud",
  input: { text: "The meeting is at noon." },
  preview: null,
  options: [
    { optionId: "allow_once", name: "Allow", kind: "allow_once" },
    { optionId: "allow_always", name: "Allow speech in this session", kind: "allow_always" },
    { optionId: "reject_once", name: "Don't", kind: "reject_once" },
    { optionId: "reject_always", name: "Never speak in this session", kind: "reject_always" },
  ],
  expiresAt: null,
  timeoutS: null,
  answer: (response) => answers.push(response),
};

beforeEach(() => {
  vi.useFakeTimers();
  vi.stubGlobal("ResizeObserver", Observer);
  inFront = vi.spyOn(document, "hasFocus").mockReturnValue(true);
  answers.length = 0;
  setState({
    ...INITIAL,
    currentId: "s1",
    auth: { status: "in", me: { name: "Ana", role: "supervisor", robot: "Sancho" } },
  });
  render(<QuestionCard question={QUESTION} count={1} />);
  return () => vi.useRealTimers();
});

const later = (ms: number): void => {
  act(() => void vi.advanceTimersByTime(ms));
};

describe("the question", () => {
  it("says who asks for what in plain words", () => {
    const card = screen.getByRole("alertdialog", { name: "Sancho asks" });
    expect(card.textContent).toContain("Say aloud: “The meeting is at noon.”");
    expect(card.textContent).toContain("asked by you");
  });

  it("puts the focus on the safe answer", () => {
    expect(document.activeElement).toBe(screen.getByTestId("permission-reject"));
  });

  it("gives the focus to the field when it goes, and on a touch screen to the conversation", () => {
    const beside = document.createElement("div");
    beside.innerHTML = '<div id="conversation" tabindex="0"></div><textarea id="composer"></textarea>';
    document.body.append(beside);
    cleanup();
    expect(document.activeElement?.id).toBe("composer");
    (document.activeElement as HTMLElement).blur();
    vi.spyOn(window, "matchMedia").mockReturnValue({ matches: true } as MediaQueryList);
    render(<QuestionCard question={QUESTION} count={1} />);
    expect(document.activeElement).toBe(screen.getByTestId("permission-reject"));
    cleanup();
    expect(document.activeElement?.id).toBe("conversation");
    beside.remove();
  });

  it("leaves the focus alone where it was elsewhere", () => {
    screen.getByTestId("permission-allow");
    (document.activeElement as HTMLElement).blur();
    cleanup();
    expect(document.activeElement).toBe(document.body);
  });

  it("cannot be allowed in its first moment", () => {
    const allow = screen.getByTestId("permission-allow");
    later(350);
    fireEvent.click(allow, { detail: 1 });
    expect(answers).toEqual([]);
    later(100);
    fireEvent.click(allow, { detail: 1 });
    expect(answers).toEqual([{ outcome: { outcome: "selected", optionId: "allow_once" } }]);
  });

  it("is not allowed by the second click of a double click, which another question may have got", () => {
    const allow = screen.getByTestId("permission-allow");
    later(450);
    fireEvent.click(allow, { detail: 2 });
    expect(answers).toEqual([]);
    fireEvent.click(allow, { detail: 1 });
    expect(answers).toHaveLength(1);
  });

  it("cannot be allowed by the click that brings its window to the front", () => {
    const allow = screen.getByTestId("permission-allow");
    inFront.mockReturnValue(false);
    later(5000);
    inFront.mockReturnValue(true);
    fireEvent.focus(window);
    later(100);
    fireEvent.click(allow, { detail: 1 });
    expect(answers).toEqual([]);
    later(400);
    fireEvent.click(allow, { detail: 1 });
    expect(answers).toHaveLength(1);
  });

  it("can be allowed with the first click after one into the map, whose frame takes the keyboard", () => {
    later(450);
    fireEvent.blur(window);
    fireEvent.focus(window);
    fireEvent.click(screen.getByTestId("permission-allow"), { detail: 1 });
    expect(answers).toHaveLength(1);
  });

  it("shows how far it is, and what its title leaves out", () => {
    cleanup();
    const drive: Question = {
      ...QUESTION,
      tool: "navigate_to_pose",
      title: "Drive to (4.2, 3.0)",
      input: { x: 4.2, y: 3, yaw: 1.5 },
      preview: { pathLength: 14.24, seconds: 25.4 },
    };
    render(<QuestionCard question={drive} count={1} />);
    const way = screen.getByTestId("permission-preview").textContent;
    expect(way).toBe("14.2 m, about 25 s, the way is drawn on the map");
    expect(screen.getByTestId("permission-arguments").textContent).toBe("yaw1.5");
  });

  it("ignores a key that was meant for what had the focus before", () => {
    const dont = screen.getByTestId("permission-reject");
    fireEvent.click(dont, { detail: 0 });
    expect(answers).toEqual([]);
    later(450);
    fireEvent.click(dont, { detail: 0 });
    expect(answers).toEqual([{ outcome: { outcome: "selected", optionId: "reject_once" } }]);
  });

  it("tells each thing once, and says what an answer for the session would count for", () => {
    expect(screen.queryByTestId("permission-arguments")).toBeNull();
    expect(screen.getByTestId("permission-rule").textContent).toBe("This answer counts once.");
    fireEvent.click(screen.getByRole("checkbox"));
    expect(screen.getByTestId("permission-rule").textContent).toContain("“Say something aloud”");
    expect(screen.getByTestId("permission-allow").textContent).toBe("Always allow");
  });

  it("answers for the session when that is ticked", () => {
    later(450);
    fireEvent.click(screen.getByRole("checkbox"));
    fireEvent.click(screen.getByTestId("permission-reject"), { detail: 1 });
    expect(answers).toEqual([{ outcome: { outcome: "selected", optionId: "reject_always" } }]);
  });
});
