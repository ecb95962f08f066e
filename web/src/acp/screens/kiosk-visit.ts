/**
 * What a kiosk does with the connection: one visit after another. A visit's session begins with its first wish and is
 * closed with the visit; of an earlier visit nothing is kept here, nothing in the address, nothing in the browser.
 */
import { methods, RequestError, type ClientContext } from "@agentclientprotocol/sdk";
import { getState, setState } from "../../state/store";
import { learnAbilities } from "../../wire/abilities";
import { end, start } from "../connection/connection";
import { attach, load, send, theAgent } from "../sessions/sessions";

const LEARN_MS = 5000;
const CWD = "/";

/** Counts visits: what comes late for an earlier one is dropped. */
let visit = 0;
/** Sessions of visits that ended while there was no connection. */
const unclosed = new Set<string>();

/** Returns what ends it. */
export function startKiosk(): () => void {
  start({
    onOpen: async (peer) => {
      for (const sessionId of unclosed) close(peer, sessionId);
      unclosed.clear();
      void learn();
      await goOn(peer);
    },
    // A kiosk never answers a question, whoever it is logged in as: staff do, on a screen of their own.
    onQuestion: (_request, withdrawn) =>
      new Promise((resolve) => {
        const gone = (): void => resolve({ outcome: { outcome: "cancelled" } });
        if (withdrawn.aborted) gone();
        else withdrawn.addEventListener("abort", gone, { once: true });
      }),
    // Nobody at this screen could cancel any more what the visitor began.
    onLeave: endVisit,
  });
  const learning = setInterval(() => void learn(), LEARN_MS);
  return () => {
    clearInterval(learning);
    endVisit();
    end();
  };
}

/** What the robot can do, asked until it is known. */
async function learn(): Promise<void> {
  if (getState().abilities === null) await learnAbilities();
}

/** After the connection was lost in the middle of a visit. */
async function goOn(peer: ClientContext): Promise<void> {
  const { currentId } = getState();
  if (currentId === null) return;
  try {
    await load(peer, currentId);
  } catch (error) {
    if (!(error instanceof RequestError)) throw error;
    endVisit();
  }
}

/** Asks for something and returns when the turn is over. Rejects when no session can be begun. */
export async function ask(text: string, author: string): Promise<void> {
  const peer = theAgent();
  if (peer === null || getState().opening) return;
  const mine = visit;
  const sessionId = getState().currentId ?? (await begin(peer, mine));
  if (sessionId === null || mine !== visit) return;
  await send(peer, sessionId, text, author);
}

async function begin(peer: ClientContext, mine: number): Promise<string | null> {
  setState({ opening: true });
  try {
    const answer = await peer.request(methods.agent.session.new, { cwd: CWD, mcpServers: [] });
    if (mine !== visit) {
      close(peer, answer.sessionId);
      return null;
    }
    setState({ currentId: answer.sessionId });
    attach(answer.sessionId, answer);
    return answer.sessionId;
  } finally {
    if (mine === visit) setState({ opening: false });
  }
}

/** The visitor has gone: what runs is cancelled, and nothing stays. */
export function endVisit(): void {
  visit++;
  const { currentId } = getState();
  const peer = theAgent();
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
  if (peer === null) unclosed.add(currentId);
  else close(peer, currentId);
}

function close(peer: ClientContext, sessionId: string): void {
  peer.request(methods.agent.session.close, { sessionId }).catch(() => undefined);
}
