/** A cut is announced once, however many attempts follow; out of a silence there is a way, too. */
import { act, render, screen } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { INITIAL, setState } from "../../state/store";
import { ConnectionBand, SilentBand } from "./connection-band";

beforeEach(() => {
  vi.useFakeTimers();
  setState({ ...INITIAL, reachable: false, link: { status: "waiting", retryAt: Date.now() + 3000 } });
});

afterEach(() => vi.useRealTimers());

it("counts down and tries again without a word to those who listen", () => {
  render(<ConnectionBand />);
  const said = screen.getByRole("status").textContent;
  expect(said).toContain("Connection lost.");
  expect(screen.getByText(/Trying again in 3 s/)).toBeDefined();
  act(() => void vi.advanceTimersByTime(1000));
  expect(screen.getByText(/Trying again in 2 s/)).toBeDefined();
  expect(screen.getByRole("status").textContent).toBe(said);
  act(() => setState({ link: { status: "connecting", first: false } }));
  expect(screen.getByText(/Trying again …/)).toBeDefined();
  expect(screen.getByRole("status").textContent).toBe(said);
});

it("lets whoever waits for a silent robot try a new line", () => {
  render(<SilentBand />);
  expect(screen.getByRole("button", { name: "Try now" })).toBeDefined();
});
