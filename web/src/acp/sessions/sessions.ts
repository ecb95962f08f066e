/**
 * What people do with sessions: open, create, delete, prompt, cancel, set mode and model. Each function takes the store
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
import { EMPTY, hasEnded, type Conversation, type UserItem } from "../../state/conversation/conversation";
import {
  cancelRequested,
  lostPrompts,
  promptEnded,
  promptFailed,
  promptSent,
  sessionOpened,
  sessionReducer,
  withoutUnconfirmed,
} from "../../state/conversation/reducer";
import type { Setting } from "../../state/conversation/settings";
import { canPrompt } from "../../state/rights";
import { mergeFirstPage } from "../../state/session-list";
import { getState, robotName, setState, toast, type State } from "../../state/store";
import { atOf, decisionOf, META, takenOverBy } from "../../wire/meta";
import { METHODS } from "../../wire/methods";
import { getAgent } from "../connection/agent";
import { agentNow, syncClock } from "../connection/agent-clock";
import { publish } from "../events/event-feed";
import { forgetRemembered, rememberSession, sessionToOpen } from "./address";
import { applyDecision, closeQuestionsOf, forgetAskedCall, forgetAskedCalls } from "./questions";

/** ACP wants a working directory; a robot's session has none. */
const CWD = "/";

/** A page that is open for days keeps this many sessions: the one on the screen, and those that were there last. */
export const RECENT_SESSIONS = 10;

/** The sessions that were on the screen, the newest last. */
let recentSessionIds: string[] = [];

/** The loads that are under way, by session. */
const loads = new Map<string, { agent: ClientContext; done: Promise<void> }>();

/** Set while a new session is being made. */
let beginning: Promise<void> | null = null;

/** Prompts whose connection was lost before their answer. The next load of the session shows whether the agent has them. */
let doubtful: { sessionId: string; text: string; settle: (arrived: boolean) => void }[] = [];

/** ACP's code for a resource that does not exist. Agents also use that for wrong parameters. */
const GONE = [-32002, -32602];

/** Does nothing for a session that the page has let go of: its updates can still be on their way. */
function updateConversation(sessionId: string, update: (conversation: Conversation) => Conversation): void {
  setState((state) => {
    const conversation = state.conversations[sessionId];
    if (conversation === undefined) return {};
    return { conversations: { ...state.conversations, [sessionId]: update(conversation) } };
  });
}

/** The timeline needs a time: an update without one has happened just now. */
function withTime(notification: SessionNotification): SessionNotification {
  if (atOf(notification._meta) !== null) return notification;
  return { ...notification, _meta: { ...notification._meta, [META.at]: agentNow() } };
}

/** Applies one update: to the replay that is under way, else to what is on the screen. */
export function receiveUpdate(notification: SessionNotification): void {
  const { sessionId, update } = notification;
  const draft = getState().drafts[sessionId];
  if (draft !== undefined) {
    setState((state) => ({ drafts: { ...state.drafts, [sessionId]: sessionReducer(draft, notification) } }));
  } else {
    syncClock(atOf(notification._meta));
    updateConversation(sessionId, (conversation) => sessionReducer(conversation, withTime(notification)));
  }
  publish(notification);
  if (update.sessionUpdate === "tool_call_update") {
    const decision = decisionOf(update._meta);
    if (decision !== null) applyDecision(sessionId, update.toolCallId, decision);
    if (hasEnded(update.status)) forgetAskedCall(sessionId, update.toolCallId);
  }
  if (update.sessionUpdate === "session_info_update" && update.title !== undefined) {
    const title = update.title;
    setState((state) => ({
      sessions: state.sessions.map((known) => (known.sessionId === sessionId ? { ...known, title } : known)),
    }));
  }
  if (update.sessionUpdate === "agent_message_chunk" && draft === undefined) {
    reportTakeOver(sessionId, takenOverBy(update._meta));
  }
}

/** Tells whoever lost control of the robot, whichever session is on the screen. */
function reportTakeOver(sessionId: string, by: string | null): void {
  const { auth, conversations } = getState();
  const lastPrompt = conversations[sessionId]?.items.findLast((item) => item.kind === "user");
  if (by === null || auth.status !== "in" || lastPrompt?.author !== auth.me.name || by === auth.me.name)
    return;
  toast("warning", i18next.t("people.lost", { name: by, robot: robotName(getState()) }));
}

export async function listSessions(): Promise<void> {
  const agent = getAgent();
  if (agent === null) return;
  const page = await agent.request(methods.agent.session.list, {});
  setState((state) => {
    // The agent lists a session once its first event has been written, so one that was just begun is missing there.
    const current = state.sessions.filter(
      (known) =>
        known.sessionId === state.currentId &&
        !page.sessions.some(({ sessionId }) => sessionId === known.sessionId),
    );
    const listed = page.nextCursor == null ? page.sessions : mergeFirstPage(state.sessions, page.sessions);
    return {
      sessions: [...current, ...listed.filter((session) => !current.includes(session))],
      // Where older sessions had been loaded, the next page begins below them.
      moreSessions: listed.length > page.sessions.length ? state.moreSessions : (page.nextCursor ?? null),
      sessionsKnown: true,
    };
  });
}

export async function listMoreSessions(): Promise<void> {
  const agent = getAgent();
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
export async function openFirstSession(mayPrompt: boolean): Promise<void> {
  const wanted = getState().currentId ?? sessionToOpen();
  if (wanted !== null && (await openSession(wanted))) return;
  const newest = getState().sessions.find(({ sessionId }) => sessionId !== wanted);
  if (newest !== undefined && (await openSession(newest.sessionId))) return;
  if (mayPrompt) await newSession();
  else setState({ currentId: null, opening: false });
}

/** Puts a session that the agent has opened into the store; from now on its updates are applied as they come. */
export function addSession(sessionId: string, answer: NewSessionResponse | LoadSessionResponse): void {
  setState((state) => {
    const { [sessionId]: draft = EMPTY, ...drafts } = state.drafts;
    return {
      drafts,
      conversations: { ...state.conversations, [sessionId]: sessionOpened(draft, answer) },
      attached: new Set(state.attached).add(sessionId),
      ...(state.currentId === sessionId ? { opening: false } : {}),
    };
  });
}

/** Puts a session into the address and among the recent ones; the oldest of these goes, unless a turn runs in it. */
function markAsRecent(sessionId: string): void {
  rememberSession(sessionId);
  const { conversations, drafts } = getState();
  const isLoaded = (other: string): boolean => other in conversations || other in drafts;
  recentSessionIds = [
    ...recentSessionIds.filter((other) => other !== sessionId && isLoaded(other)),
    sessionId,
  ];
  for (const old of recentSessionIds.slice(0, -RECENT_SESSIONS)) {
    const running = conversations[old]?.turn != null;
    if (!running && !(old in drafts)) forgetSession(old);
  }
}

/** Shows a session; false when it does not exist (any more). Throws when the connection breaks meanwhile. */
export async function openSession(sessionId: string): Promise<boolean> {
  const { attached } = getState();
  setState({ currentId: sessionId, opening: !attached.has(sessionId), notOpened: null });
  markAsRecent(sessionId);
  const agent = getAgent();
  if (attached.has(sessionId) || agent === null) return true;
  try {
    await loadSession(agent, sessionId);
    return true;
  } catch (error) {
    if (error instanceof RequestError && GONE.includes(error.code)) {
      toast("info", i18next.t("sessions.gone"));
      forgetRemembered(sessionId);
      setState((state) => ({
        ...withoutSession(state, sessionId),
        ...(state.currentId === sessionId ? { currentId: null, opening: false } : {}),
      }));
      return false;
    }
    const notOpened = error instanceof RequestError ? error.message : null;
    setState((state) => (state.currentId === sessionId ? { opening: false, notOpened } : {}));
    if (notOpened === null) throw error; // the connection broke; the next one opens the session again
    return true;
  }
}

/**
 * Replays a session, or what is new in it since the connection was lost, and watches it from then on. Throws
 * `RequestError` when the agent knows no such session.
 */
export function loadSession(agent: ClientContext, sessionId: string): Promise<void> {
  const underWay = loads.get(sessionId);
  if (underWay?.agent === agent) return underWay.done;
  const done = replay(agent, sessionId).finally(() => {
    if (loads.get(sessionId)?.done === done) loads.delete(sessionId);
  });
  loads.set(sessionId, { agent, done });
  return done;
}

async function replay(agent: ClientContext, sessionId: string): Promise<void> {
  const { canResume, conversations } = getState();
  const before = conversations[sessionId] ?? EMPTY;
  const resumes = canResume && before.lastSeq > 0;
  const draft = resumes ? withoutUnconfirmed(before) : EMPTY;
  setState((state) => ({ drafts: { ...state.drafts, [sessionId]: draft } }));
  const session = { sessionId, cwd: CWD, mcpServers: [] };
  try {
    addSession(
      sessionId,
      resumes
        ? await agent.request(methods.agent.session.resume, {
            ...session,
            _meta: { [META.after]: before.lastSeq },
          })
        : await agent.request(methods.agent.session.load, session),
    );
  } catch (error) {
    if (getAgent() === agent) forgetDraft(sessionId);
    throw error;
  }
  settleDoubts(sessionId, before);
}

/** The login ends: nobody waits for the fate of a prompt any more. */
export function forgetPrompts(): void {
  doubtful = [];
}

/** Tells those who sent a prompt before the connection was lost whether the agent has it. */
function settleDoubts(sessionId: string, before: Conversation): void {
  const after = getState().conversations[sessionId] ?? EMPTY;
  const lost = lostPrompts(before, after).map(textOf);
  const mine = doubtful.filter((prompt) => prompt.sessionId === sessionId);
  doubtful = doubtful.filter((prompt) => prompt.sessionId !== sessionId);
  for (const { text, settle } of mine) settle(!lost.includes(text));
}

function textOf({ blocks }: UserItem): string {
  return blocks.map((block) => (block.type === "text" ? block.text : "")).join("");
}

/** Watches a session without showing it, so that its permission requests come here. */
export async function watchSession(sessionId: string): Promise<void> {
  const agent = getAgent();
  if (agent === null || sessionId in getState().drafts) return;
  // Without the session or the connection there is nothing to watch.
  await loadSession(agent, sessionId).catch(() => undefined);
  await listSessions().catch(() => undefined);
}

/** Stops watching a session that is not on the screen, and drops what the page knows of it. */
export function forgetSession(sessionId: string): void {
  const { currentId, questions } = getState();
  if (sessionId === currentId || questions.some((question) => question.sessionId === sessionId)) return;
  forgetAskedCalls(sessionId);
  setState((state) => {
    const { [sessionId]: _, ...conversations } = state.conversations;
    const attached = new Set(state.attached);
    attached.delete(sessionId);
    return { conversations, attached };
  });
  // An agent that does not know this method keeps sending updates, which `updateConversation` drops.
  getAgent()
    ?.request(METHODS.leave, { sessionId })
    .catch(() => undefined);
}

function forgetDraft(sessionId: string): void {
  setState((state) => {
    const { [sessionId]: _, ...drafts } = state.drafts;
    return { drafts };
  });
}

/** Begins a session, or stays in the current one while nothing has happened in it. Two calls at a time begin one. */
export function newSession(): Promise<void> {
  beginning ??= beginSession().finally(() => {
    beginning = null;
  });
  return beginning;
}

async function beginSession(): Promise<void> {
  const agent = getAgent();
  const { currentId, conversations, attached } = getState();
  if (agent === null) return;
  if (currentId !== null && attached.has(currentId) && conversations[currentId]?.items.length === 0) return;
  const answer = await agent.request(methods.agent.session.new, { cwd: CWD, mcpServers: [] });
  addSession(answer.sessionId, answer);
  if (getState().currentId !== currentId) return; // somebody has opened another session meanwhile
  setState({ currentId: answer.sessionId, opening: false, notOpened: null });
  markAsRecent(answer.sessionId);
}

function withoutSession({ sessions, found }: State, sessionId: string): Pick<State, "sessions" | "found"> {
  const isOther = (known: { sessionId: string }): boolean => known.sessionId !== sessionId;
  return {
    sessions: sessions.filter(isOther),
    found: found && { ...found, sessions: found.sessions.filter(isOther) },
  };
}

export async function deleteSession(sessionId: string): Promise<void> {
  const agent = getAgent();
  if (agent === null) return;
  await agent.request(methods.agent.session.delete, { sessionId });
  forgetAskedCalls(sessionId);
  forgetRemembered(sessionId);
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
  const { auth } = getState();
  if (getState().currentId === null) await openFirstSession(auth.status === "in" && canPrompt(auth.me.role));
}

/**
 * Sends a prompt in the session on the screen and returns when its turn is over. False when the agent does not have it: the
 * person is told, and the text is theirs again.
 */
export async function prompt(text: string, author: string): Promise<boolean> {
  const agent = getAgent();
  const sessionId = getState().currentId;
  const arrived = agent !== null && sessionId !== null && (await promptIn(agent, sessionId, text, author));
  if (!arrived) toast("warning", i18next.t("composer.notSent"));
  return arrived;
}

async function promptIn(
  agent: ClientContext,
  sessionId: string,
  text: string,
  author: string,
): Promise<boolean> {
  setState((state) => ({ sessions: promptedFirst(state.sessions, sessionId, text) }));
  const arrived = await sendPrompt(agent, sessionId, text, author);
  await listSessions().catch(() => undefined);
  return arrived;
}

/** Sends a prompt and returns when its turn is over. False when it was lost with the connection, known once there is another. */
export async function sendPrompt(
  agent: ClientContext,
  sessionId: string,
  text: string,
  author: string,
): Promise<boolean> {
  updateConversation(sessionId, (conversation) => promptSent(conversation, text, author, agentNow()));
  try {
    const answer = await agent.request(methods.agent.session.prompt, {
      sessionId,
      prompt: [{ type: "text", text }],
    });
    updateConversation(sessionId, (conversation) => promptEnded(conversation, answer.stopReason, agentNow()));
  } catch (error) {
    // A lost connection ends no turn: loading the session again shows whether it still runs.
    if (!(error instanceof RequestError) || getAgent() !== agent) {
      return new Promise((settle) => doubtful.push({ sessionId, text, settle }));
    }
    updateConversation(sessionId, (conversation) => promptFailed(conversation, error.message));
  }
  closeQuestionsOf(sessionId);
  return true;
}

/** The list with the session that was just prompted at its top. */
function promptedFirst(
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
  const agent = getAgent();
  const sessionId = getState().currentId;
  if (agent === null || sessionId === null) return;
  updateConversation(sessionId, cancelRequested);
  await agent.notify(methods.agent.session.cancel, { sessionId });
}

/** Sets the mode or the model of the session on the screen. */
export async function applySetting(setting: Setting, value: string): Promise<void> {
  const agent = getAgent();
  const sessionId = getState().currentId;
  if (agent === null || sessionId === null) return;
  try {
    if (setting.configId === null) {
      await agent.request(methods.agent.session.setMode, { sessionId, modeId: value });
      updateConversation(sessionId, (conversation) =>
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
      updateConversation(sessionId, (conversation) => ({ ...conversation, options: answer.configOptions }));
    }
  } catch (error) {
    if (error instanceof RequestError) toast("warning", error.message, "en");
  }
}
