/** A person is called once for each question; where the browser forbids something, nothing breaks. */
import { STORAGE } from "../browser-storage";
import { beforeEach, describe, expect, it, vi } from "vitest";
import { AnnouncedQuestions } from "./announced-questions";
import { requestNotificationPermission, notify, useNotificationPermission } from "./notification";
import { updateAttentionSettings, useAttentionSettings } from "./settings";
import { chime, prepareAudioAtGesture } from "./sound";

const question = (toolCallId: string): { sessionId: string; toolCallId: string } => ({
  sessionId: "s1",
  toolCallId,
});

beforeEach(() => vi.unstubAllGlobals());

it("calls once for each question, also when it comes again after a cut", () => {
  const calls = new AnnouncedQuestions();
  expect(calls.takeNew([question("a")])).toEqual([question("a")]);
  expect(calls.takeNew([question("a"), question("b")])).toEqual([question("b")]);
  expect(calls.takeNew([])).toEqual([]);
  expect(calls.takeNew([question("a")])).toEqual([]);
  expect(calls.takeNew([{ ...question("a"), sessionId: "s2" }])).toHaveLength(1);
});

it("remembers what was chosen", () => {
  updateAttentionSettings({ sound: false });
  expect(useAttentionSettings.getState()).toMatchObject({ sound: false, notify: true });
  expect(JSON.parse(window.localStorage.getItem(STORAGE.attention) ?? "")).toEqual({
    sound: false,
    notify: true,
  });
});

describe("notifications", () => {
  class Shown {
    static permission = "granted";
    static all: Shown[] = [];
    static requestPermission = vi.fn(() => Promise.resolve("granted"));
    onclick: (() => void) | null = null;
    close = vi.fn();
    constructor(
      readonly title: string,
      readonly options: NotificationOptions,
    ) {
      Shown.all.push(this);
    }
  }

  it("bring the page to the front and go", () => {
    vi.stubGlobal("Notification", Shown);
    const clicked = vi.fn();
    const focus = vi.spyOn(window, "focus").mockImplementation(() => undefined);
    const close = notify("q1", "Sancho asks", "Drive to the kitchen", clicked);
    const [shown] = Shown.all;
    expect(shown).toMatchObject({ title: "Sancho asks", options: { body: "Drive to the kitchen" } });
    shown?.onclick?.();
    expect(focus).toHaveBeenCalled();
    expect(clicked).toHaveBeenCalled();
    close();
    expect(shown?.close).toHaveBeenCalled();
  });

  it("are given up where only a service worker may show one", () => {
    const forbidden = (): void => {
      throw new TypeError("Illegal constructor");
    };
    vi.stubGlobal("Notification", Object.assign(forbidden, { permission: "granted" }));
    notify("q1", "Sancho asks", "", () => undefined)();
    expect(useNotificationPermission.getState().permission).toBe("none");
  });

  it("are asked for only by a call", async () => {
    vi.stubGlobal("Notification", Shown);
    expect(Shown.requestPermission).not.toHaveBeenCalled();
    await requestNotificationPermission();
    expect(useNotificationPermission.getState().permission).toBe("granted");
  });
});

it("is silent before a gesture, and where there is no sound", () => {
  const made = vi.fn();
  vi.stubGlobal(
    "AudioContext",
    class {
      constructor() {
        made();
      }
      resume = (): Promise<void> => new Promise(() => undefined);
    },
  );
  const off = prepareAudioAtGesture();
  chime();
  expect(made).not.toHaveBeenCalled();
  window.dispatchEvent(new Event("pointerdown"));
  window.dispatchEvent(new Event("pointerdown"));
  expect(made).toHaveBeenCalledTimes(1);
  off();
});
