/** Whoever has the page behind another one is told of every question, and comes to it with one click. */
import { act, renderHook } from "@testing-library/react";
import { beforeEach, expect, it, vi } from "vitest";
import { getState, INITIAL, setState, type Question } from "../state/store";
import { useAttentionSettings } from "./settings";
import * as sound from "./sound";
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

const question = (toolCallId: string, title: string, key = toolCallId): Question =>
  ({ key, sessionId: "s1", toolCallId, title }) as Question;

beforeEach(() => {
  vi.stubGlobal("Notification", Shown);
  Shown.all = [];
  vi.spyOn(document, "hasFocus").mockReturnValue(false);
  vi.spyOn(window, "focus").mockImplementation(() => undefined);
  vi.spyOn(sound, "chime");
  setState(INITIAL);
  useAttentionSettings.setState({ sound: true, notify: true });
});

it("shows each of two that come at once, and takes away the one that was answered", () => {
  const clicked = vi.fn();
  renderHook(() => useAttention(clicked));
  const [drive, say] = [question("q1", "Drive to the kitchen"), question("q2", "Say hello")];
  act(() => setState({ questions: [drive, say] }));
  expect(Shown.all.map(({ options }) => options.body)).toEqual(["Drive to the kitchen", "Say hello"]);
  act(() => Shown.all[0]?.onclick?.());
  expect(clicked).toHaveBeenCalledOnce();
  act(() => setState({ questions: [say] }));
  expect(Shown.all.map(({ close }) => close.mock.calls.length)).toEqual([2, 0]);
});

it("is shown again after a cut that took it away, without another sound", () => {
  renderHook(() => useAttention(vi.fn()));
  act(() => setState({ questions: [question("c1", "Say hello", "q1")] }));
  act(() => setState({ questions: [] }));
  expect(Shown.all[0]?.close).toHaveBeenCalledOnce();
  act(() => setState({ questions: [question("c1", "Say hello", "q2")] }));
  expect(Shown.all).toHaveLength(2);
  expect(Shown.all[1]?.close).not.toHaveBeenCalled();
  expect(sound.chime).toHaveBeenCalledOnce();
});

it("stays when the same question is put once more in its place", () => {
  renderHook(() => useAttention(vi.fn()));
  act(() => setState({ questions: [question("c1", "Say hello", "q1")] }));
  act(() => setState({ questions: [question("c1", "Say hello", "q2")] }));
  expect(Shown.all).toHaveLength(1);
  expect(Shown.all[0]?.close).not.toHaveBeenCalled();
});

it("calls with the other one, too, when one comes after the page has gone behind", () => {
  const inFront = vi.spyOn(document, "hasFocus").mockReturnValue(true);
  renderHook(() => useAttention(vi.fn()));
  act(() => setState({ questions: [question("c1", "Say hello")] }));
  expect(Shown.all).toEqual([]);
  inFront.mockReturnValue(false);
  act(() => setState({ questions: [question("c1", "Say hello"), question("c2", "Drive")] }));
  expect(Shown.all.map(({ options }) => options.body)).toEqual(["Say hello", "Drive"]);
});

it("has the name of its own question, so that no other page's takes its place unheard", () => {
  renderHook(() => useAttention(vi.fn()));
  act(() => setState({ questions: [question("c1", "Say hello", "q1"), question("c2", "Drive", "q2")] }));
  act(() => setState({ questions: [] }));
  act(() => setState({ questions: [question("c1", "Say hello", "q3")] }));
  const [hello, drive, again] = Shown.all.map(({ options }) => options.tag);
  expect(hello).not.toBe(drive);
  expect(again).toBe(hello);
});

it("brings the question that was clicked to the front", () => {
  renderHook(() => useAttention(vi.fn()));
  act(() => setState({ questions: [question("c1", "Say hello"), question("c2", "Drive")] }));
  act(() => Shown.all[1]?.onclick?.());
  expect(getState().questions.map(({ title }) => title)).toEqual(["Drive", "Say hello"]);
});
