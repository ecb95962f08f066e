/** After a lost connection a kiosk goes on with its visit, as soon as the agent can load it. */
import { RequestError } from "@agentclientprotocol/sdk";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { getState, INITIAL, setState } from "../../state/store";
import { setAgent } from "../connection/agent";
import * as connection from "../connection/connection";
import { endVisit, startKiosk } from "./kiosk-visit";

const AWAY = new RequestError(-32603, "The session log cannot be read.", { unavailable: "database" });
const GONE = new RequestError(-32602, "There is no such session.");

let screen: connection.Screen;
let end: () => void;
let failure: RequestError | null = AWAY;

const agent = {
  request: vi.fn((method: string) => {
    if (method.startsWith("session/") && failure !== null) return Promise.reject(failure);
    return Promise.resolve({});
  }),
};

/** How often the visit's session was asked for. */
const loads = (): number =>
  agent.request.mock.calls.filter(([method]) => method === "session/load" || method === "session/resume")
    .length;

beforeEach(() => {
  vi.useFakeTimers();
  vi.spyOn(connection, "startConnection").mockImplementation((started) => {
    screen = started;
  });
  agent.request.mockClear();
  failure = AWAY;
  setState({ ...INITIAL, link: { status: "online" }, currentId: "s1" });
  setAgent(agent as never);
  end = startKiosk();
});

afterEach(() => {
  end();
  vi.useRealTimers();
});

it("asks again while the database is away, and no more when the visit is there", async () => {
  await screen.onOpen(agent as never, { protocolVersion: 1 });
  await vi.advanceTimersByTimeAsync(11_000);
  expect(getState().currentId).toBe("s1");
  expect(loads()).toBe(3);
  failure = null;
  await vi.advanceTimersByTimeAsync(30_000);
  expect(getState()).toMatchObject({ currentId: "s1" });
  expect(loads()).toBe(4);
});

it("ends a visit whose session has gone", async () => {
  failure = GONE;
  await screen.onOpen(agent as never, { protocolVersion: 1 });
  expect(getState().currentId).toBeNull();
});

it("asks for nothing any more once the visitor has gone", async () => {
  await screen.onOpen(agent as never, { protocolVersion: 1 });
  endVisit();
  await vi.advanceTimersByTimeAsync(30_000);
  expect(loads()).toBe(1);
});
