/** One part of the screen fails alone, says so, and comes back. */
import { act, fireEvent, render, screen } from "@testing-library/react";
import { Suspense } from "react";
import { beforeEach, expect, it, vi } from "vitest";
import { INITIAL, setState } from "../../state/store";
import { chunk } from "./chunk";
import { Crash } from "./crash";
import { PaneBoundary } from "./pane-boundary";

let broken: boolean;

/** A part that is loaded when it is needed. */
function shown(part: React.ReactNode): void {
  render(
    <PaneBoundary name="Activity">
      <Suspense fallback={<p>one moment</p>}>{part}</Suspense>
    </PaneBoundary>,
  );
}

function Part() {
  if (broken) throw new Error("a bug");
  return <p>the part</p>;
}

beforeEach((): void => {
  vi.spyOn(console, "error").mockImplementation(() => undefined);
  setState(INITIAL);
  document.head.innerHTML = '<script type="module" src="/assets/index-old.js"></script>';
  broken = true;
});

/** What the server answers from now on when it is asked for the page. */
function serves(build: string): void {
  const answer = `<script type="module" crossorigin src="/assets/index-${build}.js"></script>`;
  vi.stubGlobal("fetch", () => Promise.resolve(new Response(answer)));
}

it("leaves the parts beside it on the screen, and comes back by a button", () => {
  render(
    <>
      <PaneBoundary name="Map">
        <Part />
      </PaneBoundary>
      <p>another part</p>
    </>,
  );
  expect(screen.getByText("another part")).toBeDefined();
  expect(screen.getByRole("alert").textContent).toContain("went wrong: Map.");
  broken = false;
  fireEvent.click(screen.getByRole("button", { name: "Try again" }));
  expect(screen.getByText("the part")).toBeDefined();
});

it("is loaded again where it could not be loaded", async () => {
  serves("old");
  const load = vi.fn<() => Promise<{ default: () => React.ReactNode }>>();
  load
    .mockRejectedValueOnce(new TypeError("Failed to fetch"))
    .mockResolvedValue({ default: () => <p>here</p> });
  const late = chunk(load);
  shown(<late.Component />);
  await screen.findByText("This part of the screen could not be loaded: Activity.");
  fireEvent.click(screen.getByRole("button", { name: "Try again" }));
  await screen.findByText("here");
  expect(load).toHaveBeenCalledTimes(2);
});

it("offers the newer version where the server has another build", async () => {
  serves("new");
  const late = chunk<object>(() => Promise.reject(new TypeError("Failed to fetch")));
  shown(<late.Component />);
  await screen.findByText(/There is a newer version of this page/);
  expect(screen.getByRole("button", { name: "Load the newer version" })).toBeDefined();
});

it("shows on the crash screen that its Stop failed, and then that the robot is stopped", async () => {
  vi.stubGlobal("fetch", () => Promise.resolve(new Response("<!doctype html>")));
  render(
    <Crash>
      <Part />
    </Crash>,
  );
  expect(document.body.textContent).not.toContain("Stop works");
  await act(() => Promise.resolve(fireEvent.click(screen.getByTestId("stop"))));
  const failed = await screen.findByTestId("stop-failed");
  expect(failed.textContent).toContain("Use the stop button on the robot.");
  vi.stubGlobal("fetch", () => Promise.resolve(Response.json({ stopped: { by: "Ana", at: 7 } })));
  fireEvent.click(screen.getByRole("button", { name: "Stop again" }));
  await screen.findByText(/Stopped by Ana/);
  expect(screen.queryByTestId("stop-failed")).toBeNull();
});

it("stays on the crash screen where the server has no page to load", async () => {
  vi.stubGlobal("fetch", () => Promise.reject(new TypeError("Failed to fetch")));
  render(
    <Crash>
      <Part />
    </Crash>,
  );
  fireEvent.click(screen.getByRole("button", { name: "Load again" }));
  await screen.findByText(/does not answer/);
  expect(screen.getByTestId("stop")).toBeDefined();
});
