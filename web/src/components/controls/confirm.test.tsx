/** Where the keyboard goes on after something that takes away what it was on. */
import { act, fireEvent, render, screen, waitFor } from "@testing-library/react";
import type { ClientContext } from "@agentclientprotocol/sdk";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { INITIAL, setState } from "../../state/store";
import { PANES_ID } from "./panes";
import { SessionPane } from "../sessions/session-pane";
import { StopBand } from "../alerts/stop-band";
import { setAgent } from "../../acp/connection/agent";

const focused = (): Element | null => document.activeElement;

beforeEach(() => {
  vi.stubGlobal("fetch", () => Promise.resolve(Response.json({ stopped: null })));
  setAgent({ request: () => Promise.resolve({}) } as unknown as ClientContext);
  setState({
    ...INITIAL,
    auth: { status: "in", me: { name: "Sue", role: "supervisor", robot: "Sancho" } },
    link: { status: "online" },
    canDelete: true,
    sessionsKnown: true,
    currentId: "c",
    sessions: ["a", "b", "c"].map((id) => ({ sessionId: id, cwd: "/", title: `Session ${id}` })),
  });
});

afterEach(() => {
  setAgent(null);
  vi.unstubAllGlobals();
});

it("is the next session when one was deleted", async () => {
  render(<SessionPane onChosen={() => undefined} />);
  const doomed = screen.getByRole("button", { name: /Delete.*Session a/ });
  doomed.focus();
  fireEvent.click(doomed);
  fireEvent.click(await screen.findByRole("button", { name: "Delete" }));
  await waitFor(() => expect(screen.queryByText("Session a")).toBeNull());
  await waitFor(() => expect(focused()?.textContent).toContain("Session b"));
});

it("is what is below the band when the robot was released, by whomever", async () => {
  setState({ stop: { by: "Ana", at: 7 } });
  render(
    <>
      <StopBand />
      <main id={PANES_ID} tabIndex={-1} />
    </>,
  );
  const panes = screen.getByRole("main");
  screen.getByTestId("release").focus();
  fireEvent.click(screen.getByTestId("release"));
  fireEvent.click(await screen.findByTestId("release-confirm"));
  await waitFor(() => expect(screen.queryByTestId("release")).toBeNull());
  await waitFor(() => expect(focused()).toBe(panes));

  act(() => setState({ stop: { by: "Ana", at: 8 } }));
  screen.getByTestId("release").focus();
  fireEvent.click(screen.getByTestId("release"));
  await screen.findByTestId("release-confirm");
  act(() => setState({ stop: null }));
  await waitFor(() => expect(focused()).toBe(panes));
});
