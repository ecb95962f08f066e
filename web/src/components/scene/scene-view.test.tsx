/** The buttons over the map: what they do while it is not connected, and where the keyboard goes on. */
import { act, fireEvent, render, screen } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { FakeSocket } from "../../scene/fake-socket";
import { INITIAL, setState } from "../../state/store";
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

it("moves no camera before the map is connected, says why, and lets the keyboard stay", () => {
  const view = screen.getByTestId("view-map");
  expect(view.getAttribute("aria-disabled")).toBe("true");
  expect(screen.getByText("The map is not connected yet.")).toBeDefined();
  connected();
  expect(view.getAttribute("aria-disabled")).toBe("false");
  expect(screen.queryByText("The map is not connected yet.")).toBeNull();
  view.focus();
  act(() => setState({ reachable: false }));
  expect(view.getAttribute("aria-disabled")).toBe("true");
  expect(document.activeElement).toBe(view);
  const sent = control().sent.length;
  fireEvent.click(view);
  expect(control().sent).toHaveLength(sent);
});

it("lets the robot be sent to a place of the list without the map", () => {
  expect(goHere().disabled).toBe(false);
  fireEvent.click(goHere());
  expect(screen.getByText(/takes no clicks/)).toBeDefined();
  expect(document.activeElement).toBe(screen.getByTestId("go-here-place"));
});

it("says that clicks do nothing when the map is lost meanwhile", () => {
  connected();
  fireEvent.click(goHere());
  expect(screen.queryByText(/takes no clicks/)).toBeNull();
  act(() => setState({ reachable: false }));
  expect(screen.getByText(/takes no clicks/)).toBeDefined();
  fireEvent.click(screen.getByTestId("go-here-cancel"));
  expect(document.activeElement).toBe(goHere());
});

it("has the keyboard when the camera is closed", () => {
  const close = screen.getByRole("button", { name: "Close the camera" });
  close.focus();
  fireEvent.click(close);
  expect(document.activeElement).toBe(screen.getByTestId("camera"));
});
