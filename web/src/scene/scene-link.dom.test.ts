/** What the scene tells, and that the view somebody chose outlives a lost connection. */
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { FakeSocket } from "./fake-socket";
import { newViewerId, SceneLink, type SceneEvents } from "./scene-link";
import { parseSceneMessage } from "../wire/scene";

let link: SceneLink;
let on: { [Name in keyof SceneEvents]: ReturnType<typeof vi.fn<SceneEvents[Name]>> };

const tells = (told: unknown): void => FakeSocket.last.tells(JSON.stringify(told));

function comesBack(): void {
  FakeSocket.last.closes();
  vi.advanceTimersToNextTimer();
  FakeSocket.last.opens();
}

beforeEach(() => {
  vi.useFakeTimers();
  vi.stubGlobal("WebSocket", FakeSocket);
  FakeSocket.all = [];
  on = { onView: vi.fn(), onPicked: vi.fn(), onRefused: vi.fn() };
  link = new SceneLink("v1", on);
  FakeSocket.last.opens();
  tells({ view: "map" });
});

afterEach(() => {
  link.end();
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

it("shows where the camera stands, and nothing while it does not know", () => {
  expect(FakeSocket.last.url).toContain("/scene/v1/control");
  expect(FakeSocket.last.sent).toEqual([]);
  expect(on.onView).toHaveBeenLastCalledWith("map");
  FakeSocket.last.closes();
  expect(on.onView).toHaveBeenLastCalledWith(null);
});

it("asks again for the chosen view after a lost connection", () => {
  link.show("follow");
  tells({ view: "follow" });
  comesBack();
  expect(FakeSocket.last.sent).toEqual([{ view: "follow" }]);
});

it("does so every time, whatever a new connection says first", () => {
  link.show("top");
  tells({ view: "top" });
  comesBack();
  tells({ view: "free" });
  comesBack();
  expect(FakeSocket.last.sent).toEqual([{ view: "top" }]);
});

it("leaves a camera alone that its viewer has moved", () => {
  link.show("follow");
  tells({ view: "follow" });
  tells({ view: "free" });
  comesBack();
  expect(FakeSocket.last.sent).toEqual([]);
});

it("goes on picking after a lost connection, until that is over", () => {
  link.pick(true);
  comesBack();
  expect(FakeSocket.last.sent).toEqual([{ pick: true }]);
  tells({ picked: { x: 1.5, y: 2, place: null } });
  expect(on.onPicked).toHaveBeenCalledExactlyOnceWith({ x: 1.5, y: 2, place: null });
  link.pick(false);
  tells({ picked: { x: 3, y: 4, place: null } });
  expect(on.onPicked).toHaveBeenCalledOnce();
  comesBack();
  expect(FakeSocket.last.sent).toEqual([]);
});

it("passes a refusal on", () => {
  tells({ error: "A viewer may not pick." });
  expect(on.onRefused).toHaveBeenCalledExactlyOnceWith("A viewer may not pick.");
});

it.each([
  "{",
  "[]",
  "null",
  '{"view": "sideways"}',
  '{"picked": {"x": 1}}',
  '{"picked": {"x": "1", "y": 2}}',
])("takes %s for no message", (text) => {
  expect(parseSceneMessage(text)).toBeNull();
});

it("reads nothing but text", () => {
  expect(parseSceneMessage(new Blob(['{"view": "map"}']))).toBeNull();
});

it("gives every page a name of its own", () => {
  expect(newViewerId()).toMatch(/^[0-9a-f]{8}-[0-9a-f]{4}-4[0-9a-f]{3}-[89ab][0-9a-f]{3}-[0-9a-f]{12}$/);
  expect(newViewerId()).not.toBe(newViewerId());
});
