/** Who is here: what was open stays closed after the connection was lost; and a take-over names the turn it was for. */
import { act, fireEvent, render, screen } from "@testing-library/react";
import { beforeEach, expect, it, vi } from "vitest";
import { RequestError } from "@agentclientprotocol/sdk";
import * as agent from "../../acp/connection/agent";
import { parseTelemetry } from "../../wire/telemetry";
import { getState, INITIAL, setState } from "../../state/store";
import { PeopleMenu } from "./people-menu";
import { METHODS } from "../../wire/methods";

const request = vi.fn();

const ana = { name: "Ana", role: "operator" as const, connections: 1, sessions: [] };

function held(by: string, sessionId: string): void {
  setState({
    telemetry: parseTelemetry({ robot: "Sancho", online: true, turn: { by, sessionId, queue: 0 } }),
  });
}

beforeEach(() => {
  vi.stubGlobal("matchMedia", () => ({ matches: false }));
  vi.stubGlobal(
    "ResizeObserver",
    class {
      observe = vi.fn();
      unobserve = vi.fn();
      disconnect = vi.fn();
    },
  );
  vi.clearAllMocks();
  vi.spyOn(agent, "getAgent").mockReturnValue({ request } as never);
  setState({
    ...INITIAL,
    link: { status: "online" },
    auth: { status: "in", me: { name: "Sue", role: "supervisor", robot: "Sancho" } },
    people: [ana],
  });
  held("Ana", "s1");
});

it("does not open by itself when the connection is back", () => {
  render(<PeopleMenu />);
  fireEvent.click(screen.getByTestId("people"));
  expect(screen.getByTestId("people-menu")).toBeTruthy();
  act(() => setState({ people: null, telemetry: null }));
  act(() => setState({ people: [ana] }));
  expect(screen.queryByTestId("people-menu")).toBeNull();
});

it("lists nobody as here while nothing is heard, and does not open by itself afterwards", () => {
  render(<PeopleMenu />);
  fireEvent.click(screen.getByTestId("people"));
  act(() => setState({ silentSince: 7, telemetry: null }));
  expect(screen.queryByTestId("people-menu")).toBeNull();
  expect(screen.queryByTestId("people")).toBeNull();
  act(() => setState({ silentSince: null }));
  expect(screen.getByTestId("people")).toBeDefined();
  expect(screen.queryByTestId("people-menu")).toBeNull();
});

async function takesOver(): Promise<void> {
  render(<PeopleMenu />);
  fireEvent.click(screen.getByTestId("people"));
  fireEvent.click(screen.getByTestId("take-over"));
  fireEvent.click(await screen.findByTestId("take-over-confirm"));
}

it("names the turn that the person was asked about", async () => {
  request.mockResolvedValue({ from: "Ana" });
  await takesOver();
  expect(request).toHaveBeenCalledExactlyOnceWith(METHODS.takeOver, { from: "s1" });
});

it("says who has the robot when that turn has ended meanwhile", async () => {
  request.mockRejectedValue(new RequestError(-32602, "Ben has the robot now", { holder: "Ben" }));
  await takesOver();
  await vi.waitFor(() => expect(getState().toasts).toHaveLength(1));
  expect(getState().toasts[0]?.text).toBe("Nothing was taken over: Ben has Sancho now.");
});
