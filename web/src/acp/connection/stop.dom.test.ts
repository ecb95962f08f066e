/** Stop counts only when the robot's answer says so, and waits behind nothing. */
import { beforeEach, expect, it, vi } from "vitest";
import { health } from "../../api/http";
import { getState, INITIAL, setState } from "../../state/store";
import { releaseRobot, stopRobot } from "./stop";

const HTML = "<!doctype html><title>Log in to the guest network</title>";
const page = (status = 200): Response =>
  new Response(HTML, { status, headers: { "Content-Type": "text/html" } });

function answers(answer: () => Response | Promise<Response>): void {
  vi.stubGlobal("fetch", () => Promise.resolve(answer()));
}

beforeEach(() => setState(INITIAL));

it("shows who stopped the robot, and when, as the robot says it", async () => {
  answers(() => Response.json({ stopped: { by: "Ana", at: 1795240339.5 } }));
  await stopRobot();
  expect(getState()).toMatchObject({
    stop: { by: "Ana", at: 1795240339.5 },
    stopError: null,
    stopBusy: false,
  });
});

it.each([
  ["a page of HTML", () => page()],
  ["a page of HTML with a status of its own", () => page(401)],
  ["JSON that is no stop", () => Response.json({})],
  ["a list", () => Response.json([])],
  ["a stop of nobody", () => Response.json({ stopped: { at: 1 } })],
  ["a stop without a time", () => Response.json({ stopped: { by: "Ana", at: "now" } })],
  ["no stop", () => Response.json({ stopped: null })],
  ["only a yes", () => Response.json({ stopped: true })],
])("does not count where the answer is %s", async (_what, answer) => {
  answers(answer);
  await stopRobot();
  expect(getState()).toMatchObject({ stop: null, stopError: { kind: "foreign" } });
});

it("says why the robot's server refuses, and what to do where the robot is away", async () => {
  answers(() => Response.json({ error: "You are not logged in." }, { status: 401 }));
  await stopRobot();
  expect(getState().stopError).toEqual({ kind: "refused", sentence: "You are not logged in." });
  answers(() => Response.json({ error: "Use the stop button on the robot." }, { status: 503 }));
  await stopRobot();
  expect(getState().stopError).toEqual({ kind: "told", sentence: "Use the stop button on the robot." });
  answers(() => page(502));
  await stopRobot();
  expect(getState().stopError).toEqual({ kind: "noAnswer" });
});

it("is not said to have failed by an older one that fails late", async () => {
  const late: ((answer: Response) => void)[] = [];
  answers(() => new Promise((resolve) => late.push(resolve)));
  const first = stopRobot();
  await vi.waitFor(() => expect(late).toHaveLength(1));
  answers(() => Response.json({ stopped: { by: "Ana", at: 7 } }));
  await stopRobot();
  expect(getState().stopBusy).toBe(true);
  late[0]?.(page());
  await first;
  expect(getState()).toMatchObject({ stop: { by: "Ana" }, stopError: null, stopBusy: false });
});

it("takes the connection of requests that only read", async () => {
  const given: string[] = [];
  vi.stubGlobal("fetch", (path: string, { signal, priority }: RequestInit) => {
    if (path === "/api/stop") {
      expect(given).toEqual(["/api/health"]);
      expect(priority).toBe("high");
      return Promise.resolve(Response.json({ stopped: { by: "Ana", at: 7 } }));
    }
    return new Promise((_resolve, reject) => {
      signal?.addEventListener("abort", () => {
        given.push(path);
        reject(new Error("aborted"));
      });
    });
  });
  const asked = health().catch((error: unknown) => error);
  await stopRobot();
  await asked;
  expect(getState().stop).toMatchObject({ by: "Ana" });
});

it("is not taken for released because a page of HTML came", async () => {
  setState({ stop: { by: "Ana", at: 7 } });
  answers(() => page());
  await releaseRobot();
  expect(getState().stop).toMatchObject({ by: "Ana" });
  expect(getState().toasts).toHaveLength(1);
  answers(() => Response.json({ stopped: null }));
  await releaseRobot();
  expect(getState().stop).toBeNull();
});
