/** The camera is asked for pictures only while somebody can see them, and an old picture is not shown as a new one. */
import { act, render, screen } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { FakeSocket } from "../../scene/fake-socket";
import { INITIAL, setState } from "../../state/store";
import { CameraView } from "./camera-view";

const revoked = vi.fn();

const view = (shown: boolean) => (
  <CameraView shown={shown} large={false} onLarge={() => undefined} onClose={() => undefined} />
);

function seen(visibility: DocumentVisibilityState): void {
  vi.spyOn(document, "visibilityState", "get").mockReturnValue(visibility);
  act(() => void document.dispatchEvent(new Event("visibilitychange")));
}

const open = (): number => FakeSocket.all.filter(({ readyState }) => readyState < 2).length;

beforeEach(() => {
  vi.useFakeTimers();
  vi.stubGlobal("WebSocket", FakeSocket);
  FakeSocket.all = [];
  URL.createObjectURL = vi.fn(() => "blob:picture");
  URL.revokeObjectURL = revoked;
  setState({ ...INITIAL, auth: { status: "in", me: { name: "Ana", role: "viewer", robot: "Sancho" } } });
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

it("is connected only while its pane and the page are seen", () => {
  const { rerender, unmount } = render(view(false));
  expect(open()).toBe(0);
  rerender(view(true));
  expect(open()).toBe(1);
  seen("hidden");
  expect(open()).toBe(0);
  seen("visible");
  expect(open()).toBe(1);
  unmount();
  expect(open()).toBe(0);
});

it("shows what comes, and says so when nothing comes any more", () => {
  render(view(true));
  expect(screen.getByText(/Connecting to the camera/)).toBeDefined();
  act(() => FakeSocket.last.tells(new Blob(["jpeg"])));
  expect(screen.getByRole("img", { name: "What Sancho sees now" }).getAttribute("src")).toBe("blob:picture");
  act(() => void vi.advanceTimersByTime(3000));
  expect(screen.queryByRole("img")).toBeNull();
  expect(screen.getByText(/no picture from the camera/)).toBeDefined();
  expect(revoked).toHaveBeenCalledWith("blob:picture");
});
