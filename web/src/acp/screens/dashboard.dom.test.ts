/** When the agent has its database again, the dashboard opens what could not be opened, by itself. */
import { RequestError } from "@agentclientprotocol/sdk";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { getState, INITIAL, setState } from "../../state/store";
import { parseTelemetry } from "../../wire/telemetry";
import { setAgent } from "../connection/agent";
import * as connection from "../connection/connection";
import { startDashboard } from "./dashboard";

const AWAY = { text: "The session log cannot be written.", at: 1_800_000_000 };
let screen: connection.Screen;
let end: () => void;
let isAway = true;

const agent = {
  request: vi.fn((method: string) => {
    if (isAway) throw new RequestError(-32603, AWAY.text, { unavailable: "database" });
    if (method === "session/list")
      return Promise.resolve({ sessions: [{ sessionId: "s1", cwd: "/", title: "Tour" }] });
    return Promise.resolve({});
  }),
};

function says(database: typeof AWAY | null): void {
  screen.onTelemetry?.(parseTelemetry({ robot: "Sancho", online: true, database }));
}

beforeEach(async () => {
  vi.spyOn(connection, "startConnection").mockImplementation((started) => {
    screen = started;
  });
  isAway = true;
  setState({
    ...INITIAL,
    link: { status: "online" },
    auth: { status: "in", me: { name: "Ana", role: "operator", robot: "Sancho" } },
    currentId: "s1",
  });
  setAgent(agent as never);
  end = startDashboard();
  await screen.onOpen(agent as never, { protocolVersion: 1 });
});

afterEach(() => end());

it("opens the session when the database is back, once", async () => {
  says(AWAY);
  expect(getState()).toMatchObject({ currentId: "s1", notOpened: AWAY.text });
  isAway = false;
  agent.request.mockClear();
  says(null);
  await vi.waitFor(() => expect(getState().attached.has("s1")).toBe(true));
  expect(getState()).toMatchObject({ notOpened: null, sessions: [{ sessionId: "s1" }] });
  const count = agent.request.mock.calls.length;
  says(null);
  expect(agent.request).toHaveBeenCalledTimes(count);
});
