/** Many words in one frame are drawn once, and all of them. */
import { act, renderHook } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { EMPTY } from "../state/conversation/conversation";
import { INITIAL, setState } from "../state/store";
import { useConversation } from "./use-conversation";

beforeEach(() => {
  vi.useFakeTimers();
  setState({ ...INITIAL, currentId: "s1" });
});

afterEach(() => vi.useRealTimers());

it("is drawn once a frame", () => {
  const drawn = vi.fn();
  const { result } = renderHook(() => {
    drawn();
    return useConversation();
  });
  drawn.mockClear();
  for (let made = 1; made <= 100; made++) act(() => setState({ conversations: { s1: { ...EMPTY, made } } }));
  expect(drawn).not.toHaveBeenCalled();
  act(() => void vi.advanceTimersByTime(20));
  expect(drawn).toHaveBeenCalledOnce();
  expect(result.current.made).toBe(100);
});
