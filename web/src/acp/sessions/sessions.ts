/**
 * What people do with sessions: open, make, delete, prompt, cancel, set mode and model. Each call takes the store
 * from one consistent state to the next; none of them knows a component.
 */
import {
  methods,
  RequestError,
  type ClientContext,
  type LoadSessionResponse,
  type NewSessionResponse,
  type SessionNotification,
} from "@agentclientprotocol/sdk";
import i18next from "../../i18n";
import { EMPTY, hasEnded, type Conversation } from "../../state/conversation/conversation";
import {
  cancelAsked,
  opened,
  promptEnded,
  promptFailed,
  promptSent,
  sessionReducer,
} from "../../state/conversation/reducer";
import { refreshed } from "../../state/session-list";
import type { Setting } from "../../state/conversation/settings";
import { getState, robotName, setState, toast, type State } from "../../state/store";
import { agentNow, hear } from "../connection/agent-clock";
import { tell } from "../events/event-feed";
import { atOf, decisionOf, takenOverBy } from "../../wire/meta";
import { closeQuestionsOf, decided, forgetAsked, settled } from "./questions";
import { rememberSession, sessionOfAddress } from "./address";

const CWD = "/";

/** A page that is open for days keeps this many sessions: the one on the screen, and those that were there last. */
export const KEPT = 10;

/** The sessions that were on the screen, the newest last. */
let shown: string[] = [];

/** Null while there is no connection: the one place from which the functions below reach the agent. */
let agent: ClientContext | null = null;

export const theAgent = (): ClientContext | null => agent;

export function setAgent(next: ClientContext | null): void {
  agent = next;
  if (next === null) setState({ attached: new Set(), drafts: {} });
}

/** What comes late for a session that is not here any more changes nothing. */
function change(sessionId: string, fn: (conversation: Conversation) => Conversation): void {
  setState((state) => {
    const conversation = state.conversations[sessionId];
    if (conversation === undefined) return {};
    return { conversations: { ...state.conversations, [sessionId]: fn(conversation) } };
  });
}

/** For the timeline: an agent that does not tell when something happened tells it when it happens. */
function dated(notification: SessionNotification): SessionNotification {
  if (atOf(notification._meta) !== null) return notification;
  return { ...notification, _meta: { ...notification._meta, "robot-acp/at": agentNow() } };
}

/** Takes in one update: into the replay that is under way, else into what is on the screen. */
export function receive(notification: SessionNotification): void {
  const { sessionId, update } = notification;
  const draft = getState().drafts[sessionId];
  if (draft !== undefined) {
    setState((state) => ({ drafts: { ...state.drafts, [sessionId]: sessionReducer(draft, notification) } }));
  } else {
    hear(atOf(notification._meta));
    change(sessionId, (conversation) => sessionReducer(conversation, dated(notification)));
  }
  tell(notification);
  if (update.sessionUpdate === "tool_call_update") {
    const decision = decisionOf(update._meta);
    if (decision !== null) decided(sessionId, update.toolCallId, decision);
    if (hasEnded(update.status)) settled(sessionId, update.toolCallId);
  }
  if (update.sessionUpdate === "session_info_update" && update.title !== undefined) {
    const title = update.title;
    setState((state) => ({
      sessions: state.sessions.map((known) => (known.sessionId === sessionId ? { ...known, title } : known)),
    }));
  }
  if (update.sessionUpdate === "agent_message_chunk" && draft === undefined) {
    tellLoser(sessionId, takenOverBy(update._meta));
  }
}

/** Whoever loses the robot learns it whatever is on the screen just then. */
function tellLoser(sessionId: string, by: string | null): void {
  const { auth, conversations } = getState();
  const asked = conversations[sessionId]?.items.findLast((item) => item.kind === "user");
  if (by === null || auth.status !== "in" || asked?.author !== auth.me.name || by === auth.me.name) return;
  toast("danger", i18next.t("people.lost", { name: by, robot: robotName(getState()) }));
}

export async function listSessions(): Promise<void> {
  const peer = agent;
  if (peer === null) return;
  const page = await peer.request(methods.agent.session.list, {});
  setState((state) => {
    // One that was just begun here is not on the list before its first event has been written.
    const current = state.sessions.filter(
      (known) =>
        known.sessionId === state.currentId &&
        !page.sessions.some(({ sessionId }) => sessionId === known.sessionId),
    );
    const listed = page.nextCursor == null ? page.sessions : refreshed(state.sessions, page.sessions);
    return {
      sessions: [...current, ...listed.filter((session) => !current.includes(session))],
      // Where older ones had been read, it goes on below them.
      moreSessions: listed.length > page.sessions.length ? state.moreSessions : (page.nextCursor ?? null),
      sessionsKnown: true,
    };
  });
}

export async function listMoreSessions(): Promise<void> {
  const cursor = getState().moreSessions;
  if (agent === null || cursor === null) return;
  const page = await agent.request(methods.agent.session.list, { cursor });
  setState((state) => ({
    sessions: [
      ...state.sessions,
      ...page.sessions.filter(
        ({ sessionId }) => !state.sessions.some((known) => known.sessionId === sessionId),
      ),
    ],
    moreSessions: page.nextCursor ?? null,
  }));
}

/** After connecting: the session of the address, else the last one, else the newest, else a new one. */
export async function openFirst(mayPrompt: boolean): Promise<void> {
  const wanted = getState().currentId ?? sessionOfAddress();
  if (wanted !== null && (await openSession(wanted))) return;
  const newest = getState().sessions.find(({ sessionId }) => sessionId !== wanted);
  if (newest !== undefined && (await openSession(newest.sessionId))) return;
  if (mayPrompt) await newSession();
  else setState({ currentId: null, opening: false });
}

export function attach(sessionId: string, answer: NewSessionResponse | LoadSessionResponse): void {
  setState((state) => {
    const { [sessionId]: draft = EMPTY, ...drafts } = state.drafts;
    return {
      drafts,
      conversations: { ...state.conversations, [sessionId]: opened(draft, answer) },
      attached: new Set(state.attached).add(sessionId),
      ...(state.currentId === sessionId ? { opening: false } : {}),
    };
  });
}

/** In the address, and among those that are kept; whichever was left longest ago goes, unless a turn runs in it. */
function putOnScreen(sessionId: string): void {
  rememberSession(sessionId);
  const { conversations, drafts } = getState();
  const here = (other: string): boolean => other in conversations || other in drafts;
  shown = [...shown.filter((other) => other !== sessionId && here(other)), sessionId];
  for (const old of shown.slice(0, -KEPT)) {
    const running = conversations[old]?.turn != null;
    if (!running && !(old in drafts)) forgetSession(old);
  }
}

/** Shows a session; false when it does not exist (any more). Throws when the connection breaks meanwhile. */
export async function openSession(sessionId: string): Promise<boolean> {
  const { attached, drafts } = getState();
  setState({ currentId: sessionId, opening: !attached.has(sessionId) });
  putOnScreen(sessionId);
  const peer = agent;
  if (attached.has(sessionId) || sessionId in drafts || peer === null) return true;
  try {
    await load(peer, sessionId);
    return true;
  } catch (error) {
    if (!(error instanceof RequestError)) throw error;
    toast("info", i18next.t("sessions.gone"));
    setState((state) => ({
      ...withoutSession(state, sessionId),
      ...(state.currentId === sessionId ? { currentId: null, opening: false } : {}),
    }));
    return false;
  }
}

/** Replays a session and watches it from then on. Throws `RequestError` when the agent knows none. */
export async function load(peer: ClientContext, sessionId: string): Promise<void> {
  setState((state) => ({ drafts: { ...state.drafts, [sessionId]: EMPTY } }));
  try {
    attach(
      sessionId,
      await peer.request(methods.agent.session.load, { sessionId, cwd: CWD, mcpServers: [] }),
    );
  } catch (error) {
    forgetDraft(sessionId);
    throw error;
  }
}

/** Watches a session without showing it, to be asked its questions. */
export async function watchSession(sessionId: string): Promise<void> {
  if (agent === null || sessionId in getState().drafts) return;
  // Gone, or the connection is: there is nothing to watch.
  await load(agent, sessionId).catch(() => undefined);
  await listSessions().catch(() => undefined);
}

/** Lets go of a session that is not on the screen: what comes of it is not kept any more. */
export function forgetSession(sessionId: string): void {
  const { currentId, questions } = getState();
  if (sessionId === currentId || questions.some((question) => question.sessionId === sessionId)) return;
  forgetAsked(sessionId);
  setState((state) => {
    const { [sessionId]: _, ...conversations } = state.conversations;
    const attached = new Set(state.attached);
    attached.delete(sessionId);
    return { conversations, attached };
  });
  // An agent that does not know this goes on sending, and that is dropped.
  agent?.request("_robot/leave", { sessionId }).catch(() => undefined);
}

function forgetDraft(sessionId: string): void {
  setState((state) => {
    const { [sessionId]: _, ...drafts } = state.drafts;
    return { drafts };
  });
}

/** Begins a session, or stays in the current one while nothing has happened in it. */
export async function newSession(): Promise<void> {
  const { currentId, conversations, attached } = getState();
  if (agent === null) return;
  if (currentId !== null && attached.has(currentId) && conversations[currentId]?.items.length === 0) return;
  const answer = await agent.request(methods.agent.session.new, { cwd: CWD, mcpServers: [] });
  attach(answer.sessionId, answer);
  if (getState().currentId !== currentId) return; // somebody has chosen another one meanwhile
  setState({ currentId: answer.sessionId, opening: false });
  putOnScreen(answer.sessionId);
}

function withoutSession({ sessions, found }: State, sessionId: string): Pick<State, "sessions" | "found"> {
  const others = (known: { sessionId: string }): boolean => known.sessionId !== sessionId;
  return {
    sessions: sessions.filter(others),
    found: found && { ...found, sessions: found.sessions.filter(others) },
  };
}

export async function deleteSession(sessionId: string): Promise<void> {
  if (agent === null) return;
  await agent.request(methods.agent.session.delete, { sessionId });
  forgetAsked(sessionId);
  setState((state) => {
    const { [sessionId]: _, ...conversations } = state.conversations;
    const attached = new Set(state.attached);
    attached.delete(sessionId);
    return {
      conversations,
      attached,
      ...withoutSession(state, sessionId),
      ...(state.currentId === sessionId ? { currentId: null } : {}),
    };
  });
  if (getState().currentId === null) await openFirst(true);
}

/** Sends a prompt in the session on the screen and returns when its turn is over. */
export async function prompt(text: string, author: string): Promise<void> {
  const sessionId = getState().currentId;
  if (agent === null || sessionId === null) return;
  setState((state) => ({ sessions: withCurrent(state.sessions, sessionId, text) }));
  await send(agent, sessionId, text, author);
  await listSessions().catch(() => undefined);
}

/** Sends a prompt and returns when its turn is over. */
export async function send(
  peer: ClientContext,
  sessionId: string,
  text: string,
  author: string,
): Promise<void> {
  change(sessionId, (conversation) => promptSent(conversation, text, author, agentNow()));
  try {
    const answer = await peer.request(methods.agent.session.prompt, {
      sessionId,
      prompt: [{ type: "text", text }],
    });
    change(sessionId, (conversation) => promptEnded(conversation, answer.stopReason, agentNow()));
  } catch (error) {
    // A lost connection ends no turn: loading the session again will tell how it stands.
    if (!(error instanceof RequestError) || agent !== peer) return;
    change(sessionId, (conversation) => promptFailed(conversation, error.message));
  }
  closeQuestionsOf(sessionId);
}

function withCurrent(
  sessions: ReturnType<typeof getState>["sessions"],
  sessionId: string,
  text: string,
): ReturnType<typeof getState>["sessions"] {
  const known = sessions.find((session) => session.sessionId === sessionId);
  const updatedAt = new Date().toISOString();
  return [
    known ? { ...known, updatedAt } : { sessionId, cwd: CWD, title: text.slice(0, 80), updatedAt },
    ...sessions.filter((session) => session.sessionId !== sessionId),
  ];
}

export async function cancelTurn(): Promise<void> {
  const sessionId = getState().currentId;
  if (agent === null || sessionId === null) return;
  change(sessionId, cancelAsked);
  await agent.notify(methods.agent.session.cancel, { sessionId });
}

export async function choose(setting: Setting, value: string): Promise<void> {
  const sessionId = getState().currentId;
  if (agent === null || sessionId === null) return;
  try {
    if (setting.configId === null) {
      await agent.request(methods.agent.session.setMode, { sessionId, modeId: value });
      change(sessionId, (conversation) =>
        conversation.modes
          ? { ...conversation, modes: { ...conversation.modes, current: value } }
          : conversation,
      );
    } else {
      const { configId } = setting;
      const answer = await agent.request(methods.agent.session.setConfigOption, {
        sessionId,
        configId,
        value,
      });
      change(sessionId, (conversation) => ({ ...conversation, options: answer.configOptions }));
    }
  } catch (error) {
    if (error instanceof RequestError) toast("danger", error.message, "en");
  }
}
