/**
 * What a kiosk does with the connection: one visit after another. A visit's session begins with the visitor's first request
 * and is closed with the visit; of an earlier visit nothing is kept here, nothing in the address, nothing in the browser.
 */
import { methods, RequestError, type ClientContext } from "@agentclientprotocol/sdk";
import { getState, setState } from "../../state/store";
import { getAgent } from "../connection/agent";
import { endConnection, startConnection } from "../connection/connection";
import { loadAbilities } from "../sessions/abilities";
import { addSession, loadSession, sendPrompt } from "../sessions/sessions";

/** How often what could not be loaded is asked for again. */
const AGAIN_MS = 5000;
const CWD = "/";

/** Counts visits: an answer that belongs to an earlier one is dropped. */
let visit = 0;
/** Whether the visit's session could not be loaded again, because the agent's database is away. */
let toResume = false;
/** Sessions of visits that ended while there was no connection. */
const sessionsToClose = new Set<string>();

/** Returns a function that ends it. */
export function startKiosk(): () => void {
  startConnection({
    onOpen: async (agent) => {
      for (const sessionId of sessionsToClose) closeSession(agent, sessionId);
      sessionsToClose.clear();
      void loadAbilitiesOnce();
      await resumeVisit(agent);
    },
    // A kiosk never answers a permission request, whoever it is logged in as: staff do, on a screen of their own.
    onQuestion: (_request, withdrawn) =>
      new Promise((resolve) => {
        const cancel = (): void => resolve({ outcome: { outcome: "cancelled" } });
        if (withdrawn.aborted) cancel();
        else withdrawn.addEventListener("abort", cancel, { once: true });
      }),
    // Nobody at this screen could cancel the visitor's turn any more.
    onSignOut: endVisit,
  });
  const timer = setInterval(() => {
    void loadAbilitiesOnce();
    const agent = getAgent();
    if (toResume && agent !== null) void resumeVisit(agent).catch(() => undefined); // lost again: `onOpen` resumes
  }, AGAIN_MS);
  return () => {
    clearInterval(timer);
    endVisit();
    endConnection();
  };
}

async function loadAbilitiesOnce(): Promise<void> {
  if (getState().abilities === null) await loadAbilities();
}

/** Loads the visit's session again after the connection was lost. The visit ends where the session has gone. */
async function resumeVisit(agent: ClientContext): Promise<void> {
  const { currentId } = getState();
  toResume = false;
  if (currentId === null) return;
  try {
    await loadSession(agent, currentId);
  } catch (error) {
    if (!(error instanceof RequestError)) throw error;
    if (currentId !== getState().currentId) return; // the visit has ended meanwhile
    if (isDatabaseAway(error)) toResume = true;
    else endVisit();
  }
}

function isDatabaseAway({ data }: RequestError): boolean {
  return (
    typeof data === "object" && data !== null && "unavailable" in data && data.unavailable === "database"
  );
}

/**
 * Sends the visitor's request and returns when its turn is over. False when the agent does not have it. Rejects when no
 * session can be begun.
 */
export async function sendRequest(text: string, author: string): Promise<boolean> {
  const agent = getAgent();
  if (agent === null) return false;
  if (getState().opening) return true; // of two touches of the same button one counts
  const thisVisit = visit;
  const sessionId = getState().currentId ?? (await beginSession(agent, thisVisit));
  if (sessionId === null || thisVisit !== visit) return true;
  return sendPrompt(agent, sessionId, text, author);
}

/** Null when the visit has ended meanwhile. */
async function beginSession(agent: ClientContext, thisVisit: number): Promise<string | null> {
  setState({ opening: true });
  try {
    const answer = await agent.request(methods.agent.session.new, { cwd: CWD, mcpServers: [] });
    if (thisVisit !== visit) {
      closeSession(agent, answer.sessionId);
      return null;
    }
    setState({ currentId: answer.sessionId });
    addSession(answer.sessionId, answer);
    return answer.sessionId;
  } finally {
    if (thisVisit === visit) setState({ opening: false });
  }
}

/** The visitor has gone: the running turn is cancelled, and nothing of the visit stays. */
export function endVisit(): void {
  visit++;
  toResume = false;
  const { currentId } = getState();
  const agent = getAgent();
  setState({
    currentId: null,
    opening: false,
    conversations: {},
    drafts: {},
    attached: new Set(),
    questions: [],
    toasts: [],
  });
  if (currentId === null) return;
  if (agent === null) sessionsToClose.add(currentId);
  else closeSession(agent, currentId);
}

/** The agent cancels a turn that runs in the session. */
function closeSession(agent: ClientContext, sessionId: string): void {
  agent.request(methods.agent.session.close, { sessionId }).catch(() => undefined);
}
