/** What the dashboard does with the connection: lists and opens sessions, and comes to where somebody has to decide. */
import { canApprove, canPrompt } from "../../state/rights";
import { getState, setState } from "../../state/store";
import { sessionOfHash } from "../sessions/address";
import { end, start } from "../connection/connection";
import { ask } from "../sessions/questions";
import { searchSessions } from "../sessions/search";
import { forgetSession, listSessions, openFirst, openSession, watchSession } from "../sessions/sessions";
import type { Telemetry } from "../../wire/telemetry";

const LIST_MS = 30_000;

/** The session that this page came to by itself, because it controls the robot; null when there is none. */
let guest: string | null = null;

/** Returns what ends it. */
export function startDashboard(): () => void {
  start({
    onOpen: async (_agent, hello) => {
      guest = null;
      setState({ canDelete: hello.agentCapabilities?.sessionCapabilities?.delete != null });
      await listSessions();
      const { auth } = getState();
      await openFirst(auth.status === "in" && canPrompt(auth.me.role));
    },
    onQuestion: ask,
    onTelemetry: followRobot,
    onPeople: (people) => setState({ people }),
  });
  const lists = setInterval(() => {
    if (document.visibilityState !== "visible") return;
    void listSessions().catch(() => undefined);
    const { found } = getState();
    if (found?.more === null) void searchSessions(found.words).catch(() => undefined);
  }, LIST_MS);
  window.addEventListener("hashchange", followAddress);
  window.addEventListener("popstate", followAddress);
  return () => {
    clearInterval(lists);
    window.removeEventListener("hashchange", followAddress);
    window.removeEventListener("popstate", followAddress);
    end();
  };
}

function followAddress(): void {
  const sessionId = sessionOfHash();
  if (sessionId !== null && sessionId !== getState().currentId) {
    openSession(sessionId).catch(() => undefined);
  }
}

/**
 * Whoever may decide watches the session that controls the robot, also when it was begun elsewhere, as at a kiosk:
 * only those who watch a session are asked what it may do.
 */
function followRobot({ turn }: Telemetry): void {
  const { auth, attached } = getState();
  const holder = turn?.sessionId ?? null;
  if (holder === guest || auth.status !== "in" || !canApprove(auth.me.role)) return;
  if (guest !== null) forgetSession(guest);
  guest = null;
  if (holder === null || attached.has(holder)) return;
  guest = holder;
  void watchSession(holder).then(() => {
    if (guest !== holder) forgetSession(holder); // its turn was over before it was here
  });
}
