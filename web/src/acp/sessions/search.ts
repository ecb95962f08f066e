/** Looks for sessions by words, in the agent: what is found reaches beyond the part of the list that is here. */
import { methods } from "@agentclientprotocol/sdk";
import { wordsOf } from "../../state/session-list";
import { getState, setState } from "../../state/store";
import { theAgent } from "./sessions";

const meta = (words: string): Record<string, unknown> => ({ "robot-acp/search": words });

/** Without a word in it nothing is looked for, and what was found is forgotten. */
export async function searchSessions(search: string): Promise<void> {
  const words = wordsOf(search).join(" ");
  const peer = theAgent();
  wanted = words;
  if (words === "" || peer === null) {
    setState({ found: null });
    return;
  }
  const page = await peer.request(methods.agent.session.list, { _meta: meta(words) });
  if (wanted !== words) return; // somebody has typed on
  setState({ found: { words, sessions: page.sessions, more: page.nextCursor ?? null } });
}

/** What was asked for last; answers to anything else come too late. */
let wanted = "";

export async function findMore(): Promise<void> {
  const { found } = getState();
  const peer = theAgent();
  if (found?.more == null || peer === null) return;
  const page = await peer.request(methods.agent.session.list, {
    cursor: found.more,
    _meta: meta(found.words),
  });
  if (getState().found !== found) return;
  setState({
    found: { ...found, sessions: [...found.sessions, ...page.sessions], more: page.nextCursor ?? null },
  });
}
