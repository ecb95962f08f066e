/** Whoever has the page behind another one is told of every question, and comes to it with one click. */
import { act, renderHook } from "@testing-library/react";
import { beforeEach, expect, it, vi } from "vitest";
import { INITIAL, setState, type Question } from "../state/store";
import { useAttention } from "./use-attention";

class Shown {
  static permission = "granted";
  static all: Shown[] = [];
  onclick: (() => void) | null = null;
  close = vi.fn();
  constructor(
    readonly title: string,
    readonly options: NotificationOptions,
  ) {
    Shown.all.push(this);
  }
}

const question = (key: string, title: string): Question =>
  ({ key, sessionId: "s1", toolCallId: key, title }) as Question;

beforeEach(() => {
  vi.stubGlobal("Notification", Shown);
  vi.spyOn(document, "hasFocus").mockReturnValue(false);
  vi.spyOn(window, "focus").mockImplementation(() => undefined);
  setState(INITIAL);
});

it("shows each of two that come at once, and takes away the one that was answered", () => {
  const clicked = vi.fn();
  renderHook(() => useAttention(clicked));
  const [drive, say] = [question("q1", "Drive to the kitchen"), question("q2", "Say hello")];
  act(() => setState({ questions: [drive, say] }));
  expect(Shown.all.map(({ options }) => options.body)).toEqual(["Drive to the kitchen", "Say hello"]);
  expect(new Set(Shown.all.map(({ options }) => options.tag)).size).toBe(2);
  Shown.all[0]?.onclick?.();
  expect(clicked).toHaveBeenCalledOnce();
  act(() => setState({ questions: [say] }));
  expect(Shown.all.map(({ close }) => close.mock.calls.length)).toEqual([2, 0]);
});
