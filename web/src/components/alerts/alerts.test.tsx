/** An alert that somebody has read is gone for that person: over a cut, and not for whoever logs in next. */
import { act, fireEvent, render, screen } from "@testing-library/react";
import { beforeEach, expect, it, vi } from "vitest";
import { logOut } from "../../acp/connection/connection";
import { parseTelemetry } from "../../wire/telemetry";
import { INITIAL, setState, type State } from "../../state/store";
import { Alerts } from "./alerts";

const LOW: Partial<State> = {
  link: { status: "online" },
  telemetry: parseTelemetry({
    robot: "Sancho",
    online: true,
    battery: { level: 0.15, charging: false, floor: 0.1 },
    halted: { code: "blocked", text: "Something came into the robot's way.", at: 7 },
  }),
};
const bands = (): number => screen.queryAllByRole("button", { name: "Hide this" }).length;

beforeEach(() => setState({ ...INITIAL, ...LOW }));

it("stays hidden over a cut, and is there again after a logout", async () => {
  render(<Alerts />);
  for (const button of screen.getAllByRole("button", { name: "Hide this" })) fireEvent.click(button);
  act(() => setState({ link: { status: "waiting", retryAt: 0 }, telemetry: null }));
  act(() => setState(LOW));
  expect(bands()).toBe(0);
  vi.stubGlobal("fetch", () => Promise.resolve(new Response("{}")));
  await act(logOut);
  act(() => setState(LOW));
  expect(bands()).toBe(2);
});
