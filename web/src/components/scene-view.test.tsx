/** The buttons over the map: dead while the map is not connected, and where the keyboard goes on. */
import { act, fireEvent, render, screen } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { FakeSocket } from "../scene/fake-socket";
import { INITIAL, setState } from "../state/store";
import { SceneView } from "./scene-view";

const goHere = (): HTMLButtonElement => screen.getByTestId("go-here");
const control = (): FakeSocket => {
  const found = FakeSocket.all.findLast(({ url }) => url.includes("/control"));
  if (found === undefined) throw new Error("the map is not asked for");
  return found;
};
const connected = (): void => act(() => control().tells(JSON.stringify({ view: "map" })));

beforeEach(() => {
  vi.stubGlobal("WebSocket", FakeSocket);
  vi.stubGlobal("matchMedia", () => ({ matches: false }));
  vi.stubGlobal("fetch", () => new Promise(() => undefined));
  FakeSocket.all = [];
  setState({
    ...INITIAL,
    link: { status: "online" },
    currentId: "s1",
    attached: new Set(["s1"]),
    auth: { status: "in", me: { name: "Ana", role: "operator", robot: "Sancho" } },
  });
  render(<SceneView shown alone={false} />);
});

afterEach(() => vi.unstubAllGlobals());

it("takes no wish to go somewhere before the map is connected, and says why", () => {
  expect(goHere().disabled).toBe(true);
  expect(screen.getByText("The map is not connected yet.")).toBeDefined();
  connected();
  expect(goHere().disabled).toBe(false);
  expect(screen.queryByText("The map is not connected yet.")).toBeNull();
});

it("says that clicks do nothing when the map is lost meanwhile", () => {
  connected();
  fireEvent.click(goHere());
  expect(screen.queryByText(/takes no clicks/)).toBeNull();
  act(() => setState({ reachable: false }));
  expect(screen.getByText(/takes no clicks/)).toBeDefined();
  fireEvent.click(screen.getByTestId("go-here-cancel"));
  expect(document.activeElement).toBe(screen.getByTestId("camera"));
});

it("has the keyboard when the camera is closed", () => {
  const close = screen.getByRole("button", { name: "Close the camera" });
  close.focus();
  fireEvent.click(close);
  expect(document.activeElement).toBe(screen.getByTestId("camera"));
});
