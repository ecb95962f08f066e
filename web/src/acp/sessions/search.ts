/** Searches the agent's sessions by words: it finds also sessions that the page's list has not loaded yet. */
import { methods } from "@agentclientprotocol/sdk";
import { searchWords } from "../../state/session-list";
import { getState, setState } from "../../state/store";
import { META } from "../../wire/meta";
import { getAgent } from "../connection/agent";

const searchMeta = (words: string): Record<string, unknown> => ({ [META.search]: words });

/** The words of the last search; an answer to any other comes too late. */
let latestWords = "";

/** A text without any word ends the search. */
export async function searchSessions(text: string): Promise<void> {
  const words = searchWords(text).join(" ");
  const agent = getAgent();
  latestWords = words;
  if (words === "" || agent === null) {
    setState({ found: null });
    return;
  }
  const page = await agent.request(methods.agent.session.list, { _meta: searchMeta(words) });
  if (latestWords !== words) return;
  setState({ found: { words, sessions: page.sessions, more: page.nextCursor ?? null } });
}

/** Loads the next page of what the last search found. */
export async function loadMoreResults(): Promise<void> {
  const { found } = getState();
  const agent = getAgent();
  if (found?.more == null || agent === null) return;
  const page = await agent.request(methods.agent.session.list, {
    cursor: found.more,
    _meta: searchMeta(found.words),
  });
  if (getState().found !== found) return;
  setState({
    found: { ...found, sessions: [...found.sessions, ...page.sessions], more: page.nextCursor ?? null },
  });
}
