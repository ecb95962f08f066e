/** The microphone listens to one visitor, and only until their request is sent. */
import { act, renderHook } from "@testing-library/react";
import { beforeEach, expect, it, vi } from "vitest";
import { useVoice, type Voice } from "./use-voice";

class FakeRecognition extends EventTarget {
  static all: FakeRecognition[] = [];
  lang = "";
  interimResults = false;
  start = vi.fn();
  abort = vi.fn();

  constructor() {
    super();
    FakeRecognition.all.push(this);
  }

  hears(transcript: string): void {
    this.dispatchEvent(Object.assign(new Event("result"), { results: [[{ transcript }]] }));
  }
}

const onText = vi.fn<(text: string) => void>();

function listening(): { voice: () => Voice; recognition: FakeRecognition; unmount: () => void } {
  const { result, unmount } = renderHook(() => useVoice(true, "en", onText));
  act(() => result.current.toggle());
  const recognition = FakeRecognition.all.at(-1);
  if (recognition === undefined) throw new Error("nothing listens");
  return { voice: () => result.current, recognition, unmount };
}

beforeEach(() => {
  FakeRecognition.all = [];
  onText.mockReset();
  vi.stubGlobal("SpeechRecognition", FakeRecognition);
});

it("writes what it hears", () => {
  const { recognition } = listening();
  recognition.hears("take me to the kitchen");
  expect(onText).toHaveBeenCalledExactlyOnceWith("take me to the kitchen");
});

it("ends with the request, and drops what it still hears", () => {
  const { voice, recognition } = listening();
  act(() => voice().stop());
  expect(recognition.abort).toHaveBeenCalledOnce();
  expect(voice().listening).toBe(false);
  recognition.hears("a secret");
  expect(onText).not.toHaveBeenCalled();
});

it("ends with the visitor", () => {
  const { recognition, unmount } = listening();
  unmount();
  expect(recognition.abort).toHaveBeenCalledOnce();
  recognition.hears("a secret");
  expect(onText).not.toHaveBeenCalled();
});

it("is not ended by the late end of the recording before", () => {
  const { voice, recognition } = listening();
  act(() => voice().toggle());
  act(() => voice().toggle());
  act(() => void recognition.dispatchEvent(new Event("end")));
  expect(voice().listening).toBe(true);
});
