/** Who comes after somebody else finds nothing of theirs. */
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { setComposerText, useComposerText } from "../../components/conversation/composer-text";
import { EMPTY } from "../../state/conversation/conversation";
import { getState, INITIAL, setState } from "../../state/store";
import { endConnection, logIn, logOut, reconnectNow, signInOnLoad, startConnection } from "./connection";
import { Link } from "./link";

const ended = vi.fn();

/** What the server answers from now on. */
function answers(name: string | null, role = "supervisor", refusal = 401): void {
  const me = { name, role, robot: "Sancho" };
  vi.stubGlobal("fetch", () =>
    Promise.resolve(Response.json(name === null ? {} : me, { status: name === null ? refusal : 200 })),
  );
}

beforeEach(async () => {
  setState(INITIAL);
  answers("Ana");
  await logIn("Ana's");
  vi.spyOn(Link.prototype, "start").mockImplementation(() => undefined);
  vi.spyOn(Link.prototype, "end").mockImplementation(ended);
  ended.mockClear();
  startConnection({ onOpen: () => Promise.resolve(), onQuestion: () => new Promise(() => undefined) });
  setState({
    stopError: { kind: "noAnswer" },
    hidden: { halted: 5, battery: null },
    conversations: { s1: EMPTY },
  });
  setComposerText("Go to the");
});

afterEach(() => endConnection());

it("keeps everything for the same person with another link", async () => {
  await logIn("another of Ana's");
  expect(getState()).toMatchObject({ stopError: { kind: "noAnswer" }, hidden: { halted: 5 } });
  expect(useComposerText.getState().text).toBe("Go to the");
  expect(ended).not.toHaveBeenCalled();
});

it("is a page as if loaded anew for somebody else, on a connection of their own", async () => {
  answers("Ben");
  await logIn("Ben's");
  expect(ended).toHaveBeenCalledOnce();
  expect(getState()).toEqual({
    ...INITIAL,
    auth: { status: "in", me: { name: "Ben", role: "supervisor", robot: "Sancho" } },
  });
  expect(useComposerText.getState().text).toBe("");
});

it("is the same for the same name in another role, which the old connection does not have", async () => {
  answers("Ana", "viewer");
  await logIn("Ana's for looking");
  expect(ended).toHaveBeenCalledOnce();
  expect(getState()).toMatchObject({ auth: { me: { role: "viewer" } }, conversations: {}, stopError: null });
});

it.each([
  [401, "invalid"],
  [429, "tooMany"],
  [503, "unreachable"],
])("says why a login was refused: %i is %s", async (status, problem) => {
  answers(null, "", status);
  await logIn("Ben's");
  expect(getState().auth).toEqual({ status: "out", problem });
});

it("is the same for somebody who logs in after a link that did not count", async () => {
  answers(null);
  await logIn("nobody's");
  expect(getState()).toEqual({ ...INITIAL, auth: { status: "out", problem: "invalid" } });
  answers("Ben");
  await logIn("Ben's");
  expect(getState()).toMatchObject({ conversations: {}, hidden: { halted: null } });
  expect(useComposerText.getState().text).toBe("");
});

it("gives back what somebody was writing when they come back themselves", async () => {
  await logOut();
  answers("Ana");
  await logIn("Ana's");
  expect(useComposerText.getState().text).toBe("Go to the");
});

it("notices somebody who has logged in in another tab", async () => {
  answers("Ben");
  window.dispatchEvent(new Event("online"));
  await vi.waitFor(() => expect(getState().auth).toMatchObject({ me: { name: "Ben" } }));
  expect(getState()).toMatchObject({ conversations: {}, stopError: null, hidden: { halted: null } });
});

describe("an answer that comes late", () => {
  /** The requests that wait for an answer, oldest first. */
  let waiting: { path: string; answer: (name: string | null) => void }[];
  const asked = (path: string): typeof waiting => waiting.filter((request) => request.path === path);

  beforeEach(async () => {
    await vi.waitFor(() => expect(getState().health).not.toBeNull()); // the first check has ended
    waiting = [];
    vi.stubGlobal(
      "fetch",
      (path: string, { signal }: RequestInit) =>
        new Promise((resolve, reject) => {
          signal?.addEventListener("abort", () => reject(new Error("aborted")));
          const answer = (name: string | null): void =>
            resolve(Response.json({ name, role: "supervisor" }, { status: name === null ? 401 : 200 }));
          waiting.push({ path, answer });
        }),
    );
  });

  it("does not end the login that was made meanwhile", async () => {
    reconnectNow();
    const login = logIn("Ben's");
    asked("/api/login")[0]?.answer("Ben");
    await login;
    asked("/api/me")[0]?.answer(null);
    await new Promise((resolve) => setTimeout(resolve));
    expect(getState().auth).toMatchObject({ status: "in", me: { name: "Ben" } });
  });

  it("decides nothing where the page was begun twice", async () => {
    const first = signInOnLoad();
    const second = signInOnLoad();
    asked("/api/me")[1]?.answer("Ana");
    await second;
    asked("/api/me")[0]?.answer(null);
    await first;
    expect(getState().auth).toMatchObject({ status: "in", me: { name: "Ana" } });
  });

  it("does not come before a login that is still under way", async () => {
    const login = logIn("Ben's");
    await signInOnLoad();
    expect(waiting.map(({ path }) => path)).toEqual(["/api/login"]);
    asked("/api/login")[0]?.answer("Ben");
    await login;
    expect(getState().auth).toMatchObject({ status: "in", me: { name: "Ben" } });
  });

  it("is not asked for twice at a time", () => {
    window.dispatchEvent(new Event("online"));
    window.dispatchEvent(new Event("online"));
    expect(waiting.map(({ path }) => path)).toEqual(["/api/me", "/api/me"]);
    // The first one was given up: its failure is not taken for the bridge's.
    expect(getState().reachable).toBe(true);
  });
});
