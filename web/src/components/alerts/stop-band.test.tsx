/** A stop that was told before nothing was heard any more: somebody may have released it, and nobody here would know. */
import { act, render, screen } from "@testing-library/react";
import { beforeEach, expect, it } from "vitest";
import { Notices } from "../../kiosk/notices";
import { INITIAL, setState } from "../../state/store";
import { Alerts } from "./alerts";

beforeEach(() =>
  setState({
    ...INITIAL,
    link: { status: "online" },
    auth: { status: "in", me: { name: "Sue", role: "supervisor", robot: "Sancho" } },
    stop: { by: "Ana", at: 7 },
  }),
);

it("is said to hold only while the robot is heard, and can be released all the time", () => {
  render(<Alerts />);
  const band = screen.getByTestId("stop-band");
  expect(band.textContent).toContain("Sancho does not move or speak until this is released.");
  act(() => setState({ silentSince: 8 }));
  expect(band.textContent).toContain("Stopped by Ana at");
  expect(band.textContent).not.toContain("does not move");
  expect(band.textContent).toContain("Whether it still is stopped is not known here.");
  expect(screen.getByTestId("release")).toBeDefined();
});

it("is one that was, on the screen of a visitor", () => {
  render(<Notices onStopAgain={() => undefined} />);
  const band = screen.getByTestId("kiosk-stopped");
  expect(band.textContent).toContain("Sancho is stopped.");
  act(() => setState({ silentSince: 8 }));
  expect(band.textContent).not.toContain("is stopped.");
  expect(band.textContent).toContain("Sancho was stopped.");
  expect(band.textContent).toContain("Whether it still is stopped is not known here.");
});
