/** The map's own page does not notice that the network was away; this one loads it again then, and at no other time. */
import { act, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { INITIAL, setState, type State } from "../../state/store";
import { SceneFrame } from "./scene-frame";

const HTML = { headers: { "Content-Type": "text/html" } };
const AWAY: Partial<State> = { link: { status: "waiting", retryAt: 0 } };

let answers: () => Response;
const loaded = vi.fn();

const tell = (...states: Partial<State>[]): void => {
  for (const state of states) act(() => setState(state));
};

async function shown(): Promise<HTMLIFrameElement> {
  render(<SceneFrame />);
  const frame = await screen.findByTitle<HTMLIFrameElement>("Live map with Robot");
  vi.spyOn(HTMLIFrameElement.prototype, "src", "set").mockImplementation(loaded);
  return frame;
}

beforeEach(() => {
  answers = () => new Response("", HTML);
  vi.stubGlobal("fetch", () => Promise.resolve(answers()));
  loaded.mockClear();
  setState({ ...INITIAL, link: { status: "online" } });
});

afterEach(() => vi.unstubAllGlobals());

it("comes after the conversation, and without one where the agent is away", async () => {
  const asked = vi.fn(answers);
  answers = asked;
  setState({ link: { status: "connecting", first: true } });
  render(<SceneFrame />);
  await act(() => Promise.resolve());
  expect(asked).not.toHaveBeenCalled();
  tell(AWAY);
  await screen.findByTitle("Live map with Robot");
});

it("is loaded again in its place when the network was away and is back", async () => {
  const frame = await shown();
  frame.focus();
  tell({ reachable: false }, AWAY, { reachable: true }, { link: { status: "online" } });
  await waitFor(() => expect(loaded).toHaveBeenCalledOnce());
  expect(screen.getByTitle("Live map with Robot")).toBe(frame);
  expect(document.activeElement).toBe(frame);
  tell({ reachable: false }, AWAY, { link: { status: "online" } });
  await waitFor(() => expect(loaded).toHaveBeenCalledTimes(2));
});

it("stays as it is when only an answer was slow, or only the agent away", async () => {
  const asked = vi.fn(answers);
  await shown();
  answers = asked;
  tell({ reachable: false }, { reachable: true }, AWAY, { link: { status: "online" } });
  expect(asked).not.toHaveBeenCalled();
  expect(loaded).not.toHaveBeenCalled();
});

it("is waited for when it is not back yet", async () => {
  await shown();
  answers = () => new Response("", { status: 503 });
  tell({ reachable: false }, AWAY, { reachable: true, link: { status: "online" } });
  await screen.findByText("The map is not available right now.");
});

it("is loaded again when a line that had fallen silent was given up, whatever answered meanwhile", async () => {
  await shown();
  tell({ silentSince: 7 }, AWAY, { link: { status: "online" }, silentSince: null });
  await waitFor(() => expect(loaded).toHaveBeenCalledOnce());
});

it("stays as it is when the line was lost while the robot was heard", async () => {
  const asked = vi.fn(answers);
  await shown();
  answers = asked;
  tell({ silentSince: 7 }, { silentSince: null }, AWAY, { silentSince: 8 }, { link: { status: "online" } });
  expect(asked).not.toHaveBeenCalled();
});

it("has no part in this page, and is told the language and whether it is covered", async () => {
  const frame = await shown();
  expect(frame.getAttribute("sandbox")).toBe("allow-scripts");
  const told = vi.fn();
  Object.defineProperty(frame, "contentWindow", { value: { postMessage: told } });
  document.documentElement.lang = "es";
  const message = { type: "scene-frame", lang: "es", covered: false };
  await waitFor(() => expect(told).toHaveBeenCalledWith(message, "*"));
});

it("is asked for once at a time, and given up after a while, when the bridge does not answer", async () => {
  vi.useFakeTimers();
  let open = 0;
  let most = 0;
  vi.stubGlobal(
    "fetch",
    (_path: string, { signal }: RequestInit) =>
      new Promise((_resolve, reject) => {
        most = Math.max(most, ++open);
        signal?.addEventListener("abort", () => {
          open--;
          reject(new Error("aborted"));
        });
      }),
  );
  const { unmount } = render(<SceneFrame />);
  await act(() => vi.advanceTimersByTimeAsync(5000));
  expect(open).toBe(1);
  await act(() => vi.advanceTimersByTimeAsync(55_000));
  expect(screen.getByText("The map is not available right now.")).toBeDefined();
  expect(most).toBe(1);
  unmount();
  expect(open).toBe(0);
  vi.useRealTimers();
});
