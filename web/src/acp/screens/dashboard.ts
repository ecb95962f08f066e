/**
 * What the dashboard does with the connection: lists and opens sessions, and watches the session that controls the robot,
 * so that its questions come here.
 */
import { RequestError } from "@agentclientprotocol/sdk";
import { canApprove, canPrompt } from "../../state/rights";
import { getState, setState } from "../../state/store";
import type { Telemetry } from "../../wire/telemetry";
import { endConnection, startConnection } from "../connection/connection";
import { sessionOfHash } from "../sessions/address";
import { showQuestion } from "../sessions/questions";
import { searchSessions } from "../sessions/search";
import {
  forgetSession,
  listSessions,
  openFirstSession,
  openSession,
  watchSession,
} from "../sessions/sessions";

const LIST_MS = 30_000;

/** The session that this page watches only because it controls the robot; null when there is none. */
let watchedControllerId: string | null = null;

/** Whether the agent said last that its database cannot be used. */
let databaseAway = false;

/** Returns a function that ends it. */
export function startDashboard(): () => void {
  startConnection({
    onOpen: async (_agent, initialized) => {
      watchedControllerId = null;
      databaseAway = false;
      setState({ canDelete: initialized.agentCapabilities?.sessionCapabilities?.delete != null });
      await listSessions().catch((error: unknown) => {
        if (!(error instanceof RequestError)) throw error; // an agent without its log is still connected
      });
      const { auth } = getState();
      await openFirstSession(auth.status === "in" && canPrompt(auth.me.role));
    },
    onQuestion: showQuestion,
    onTelemetry: (telemetry) => {
      watchController(telemetry);
      awaitDatabase(telemetry);
    },
    onPeople: (people) => setState({ people }),
  });
  const listTimer = setInterval(() => {
    if (document.visibilityState !== "visible") return;
    void listSessions().catch(() => undefined);
    const { found } = getState();
    if (found?.more === null) void searchSessions(found.words).catch(() => undefined);
  }, LIST_MS);
  window.addEventListener("hashchange", openSessionOfHash);
  window.addEventListener("popstate", openSessionOfHash);
  return () => {
    clearInterval(listTimer);
    window.removeEventListener("hashchange", openSessionOfHash);
    window.removeEventListener("popstate", openSessionOfHash);
    endConnection();
  };
}

function openSessionOfHash(): void {
  const sessionId = sessionOfHash();
  if (sessionId !== null && sessionId !== getState().currentId) {
    openSession(sessionId).catch(() => undefined);
  }
}

/** When the agent has its database again: lists the sessions, and opens the one that could not be opened. */
function awaitDatabase({ database }: Telemetry): void {
  const isBack = databaseAway && database === null;
  databaseAway = database !== null;
  if (!isBack) return;
  void (async () => {
    await listSessions();
    const { auth, currentId, notOpened } = getState();
    if (currentId === null || notOpened !== null)
      await openFirstSession(auth.status === "in" && canPrompt(auth.me.role));
  })().catch(() => undefined); // lost again: the band says so, and the next time this begins anew
}

/**
 * Whoever may approve watches the session that controls the robot, also one that was begun elsewhere, as at a kiosk: the
 * agent sends permission requests only to those who watch a session.
 */
function watchController({ turn }: Telemetry): void {
  const { auth, attached } = getState();
  const controllerId = turn?.sessionId ?? null;
  if (controllerId === watchedControllerId || auth.status !== "in" || !canApprove(auth.me.role)) return;
  if (watchedControllerId !== null) forgetSession(watchedControllerId);
  watchedControllerId = null;
  if (controllerId === null || attached.has(controllerId)) return;
  watchedControllerId = controllerId;
  void watchSession(controllerId).then(() => {
    if (watchedControllerId !== controllerId) forgetSession(controllerId); // its turn ended while it was being loaded
  });
}
