/**
 * Turns ACP session updates into a conversation. Pure: the same updates from EMPTY give the same conversation,
 * whether they come live or replayed, and an update that has been seen changes nothing.
 */
import type {
  ContentBlock,
  ContentChunk,
  LoadSessionResponse,
  NewSessionResponse,
  SessionNotification,
  SessionUpdate,
  ToolCall,
  ToolCallUpdate,
} from "@agentclientprotocol/sdk";
import {
  atOf,
  authorOf,
  decisionOf,
  progressOf,
  rememberedOf,
  seqOf,
  takenOverBy,
  toolOf,
  turnOf,
  waitingOf,
  type Decision,
} from "../../wire/meta";
import {
  hasEnded,
  type AgentItem,
  type Conversation,
  type Item,
  type NoteItem,
  type ToolItem,
  type UserItem,
} from "./conversation";
import { startTimeline, endTimeline, timelineReducer } from "./timeline";

type Update<Kind extends SessionUpdate["sessionUpdate"]> = Extract<SessionUpdate, { sessionUpdate: Kind }>;
type Fresh<T extends Item> = T extends Item ? Omit<T, "key"> : never;

/** A page that is open for days keeps so many items. Older ones go in bundles, because each time the list jumps. */
export const MAX_ITEMS = 400;
const BUNDLE = 100;

export function sessionReducer(state: Conversation, { update, _meta }: SessionNotification): Conversation {
  const seq = seqOf(_meta);
  if (seq !== null && seq <= state.lastSeq) return state;
  const at = atOf(_meta);
  const timeline = at === null ? state.timeline : timelineReducer(state.timeline, update, at);
  // Only the prompts that were sent from here do not come back, so a gap in the numbers is such a prompt.
  const known = seq !== null && seq > state.lastSeq + 1 ? confirmed(state) : state;
  return { ...apply(known, update), timeline, lastSeq: seq ?? state.lastSeq };
}

function apply(state: Conversation, update: SessionUpdate): Conversation {
  switch (update.sessionUpdate) {
    case "user_message_chunk":
      return userChunk(state, update);
    case "agent_message_chunk":
      return agentChunk(state, "agent", update);
    case "agent_thought_chunk":
      return agentChunk(state, "thought", update);
    case "plan":
      return planUpdate(state, update);
    case "tool_call":
      return toolCall(state, update);
    case "tool_call_update":
      return toolCallUpdate(state, update);
    case "current_mode_update":
      return withMode(state, update.currentModeId);
    case "config_option_update":
      return withOptions(state, update.configOptions);
    case "session_info_update":
      return sessionInfo(state, update);
    default:
      return state; // the other kinds of updates are not part of a conversation
  }
}

function add<T extends Item>(state: Conversation, item: Fresh<T>): Conversation {
  const made = state.made + 1;
  const dropped = state.items.length < MAX_ITEMS ? 0 : BUNDLE;
  const kept = state.items.slice(dropped);
  return { ...state, made, items: [...kept, { ...item, key: `i${made}` }], dropped: state.dropped + dropped };
}

function replaceLast(state: Conversation, item: Item): Conversation {
  return { ...state, items: [...state.items.slice(0, -1), item] };
}

function userChunk(state: Conversation, update: Update<"user_message_chunk">): Conversation {
  const turn = turnOf(update._meta);
  const turnId = turn?.id ?? null;
  const running: Conversation =
    turn?.state === "running"
      ? { ...state, turn: { id: turnId, cancelling: state.turn?.id === turnId && state.turn.cancelling } }
      : state;
  const last = state.items.at(-1);
  if (last?.kind === "user" && turnId !== null && last.turnId === turnId) {
    return replaceLast(running, { ...last, blocks: joined(last.blocks, update.content) });
  }
  return add<UserItem>(running, {
    kind: "user",
    author: authorOf(update._meta),
    turnId,
    blocks: [update.content],
  });
}

function joined(blocks: ContentBlock[], next: ContentBlock): ContentBlock[] {
  const last = blocks.at(-1);
  if (last?.type === "text" && next.type === "text") {
    return [...blocks.slice(0, -1), { ...last, text: last.text + next.text }];
  }
  return [...blocks, next];
}

function agentChunk(state: Conversation, kind: AgentItem["kind"], chunk: ContentChunk): Conversation {
  const takenBy = takenOverBy(chunk._meta);
  if (takenBy !== null) return add<NoteItem>(state, { kind: "note", stopReason: null, takenBy, error: null });
  const messageId = chunk.messageId ?? null;
  const text = chunk.content.type === "text" ? chunk.content.text : "";
  const blocks = chunk.content.type === "text" ? [] : [chunk.content];
  const last = state.items.at(-1);
  if (last?.kind === kind && (messageId === null || last.messageId === messageId)) {
    return replaceLast(state, { ...last, text: last.text + text, blocks: [...last.blocks, ...blocks] });
  }
  if (text === "" && blocks.length === 0) return state;
  return add<AgentItem>(state, { kind, messageId, text, blocks });
}

/** A turn shows one plan, where it first appeared; later plans of the turn replace it there. */
function planUpdate(state: Conversation, update: Update<"plan">): Conversation {
  for (let i = state.items.length - 1; i >= 0; i--) {
    const item = state.items[i];
    if (item?.kind === "user") break;
    if (item?.kind === "plan") return replaceAt(state, i, { ...item, entries: update.entries });
  }
  return update.entries.length === 0 ? state : add(state, { kind: "plan", entries: update.entries });
}

function replaceAt(state: Conversation, index: number, item: Item): Conversation {
  const items = state.items.slice();
  items[index] = item;
  return { ...state, items };
}

function toolCall(state: Conversation, call: ToolCall): Conversation {
  if (state.items.some((item) => item.kind === "tool" && item.id === call.toolCallId)) {
    return toolCallUpdate(state, call);
  }
  return add<ToolItem>(state, {
    kind: "tool",
    id: call.toolCallId,
    title: call.title,
    tool: toolOf(call._meta) ?? call.name ?? null,
    status: call.status ?? "pending",
    content: call.content ?? [],
    input: call.rawInput,
    output: call.rawOutput,
    progress: progressOf(call._meta),
    waiting: waitingOf(call._meta),
    decision: decisionOf(call._meta),
  });
}

function toolCallUpdate(state: Conversation, update: ToolCallUpdate): Conversation {
  const index = state.items.findLastIndex((item) => item.kind === "tool" && item.id === update.toolCallId);
  const item = state.items[index];
  if (item?.kind !== "tool") return toolCall(state, { ...update, title: update.title ?? "" } as ToolCall);
  const progress = progressOf(update._meta);
  const waiting = waitingOf(update._meta);
  const status = update.status ?? item.status;
  const tool = toolOf(update._meta) ?? item.tool;
  const decision = decisionOf(update._meta);
  return replaceAt(withRemembered(state, tool, decision), index, {
    ...item,
    status,
    title: update.title ?? item.title,
    tool,
    // The content of an update about progress or waiting repeats it in words; it is not a result.
    content: progress === null && waiting === null ? (update.content ?? item.content) : item.content,
    input: update.rawInput ?? item.input,
    output: update.rawOutput ?? item.output,
    progress: hasEnded(status) ? null : (progress ?? item.progress),
    waiting: status === "pending" ? (waiting ?? item.waiting) : null,
    decision: decision ?? item.decision,
  });
}

/** Remembers a decision that counts for the rest of the session. */
function withRemembered(state: Conversation, tool: string | null, decision: Decision | null): Conversation {
  if (tool === null || decision?.reason !== "selected" || !decision.option?.endsWith("_always")) return state;
  return { ...state, remembered: { ...state.remembered, [tool]: decision.option === "allow_always" } };
}

function withMode(state: Conversation, mode: string): Conversation {
  const modes = state.modes === null ? null : { ...state.modes, current: mode };
  const options = state.options.map((option) =>
    option.type === "select" && option.category === "mode" ? { ...option, currentValue: mode } : option,
  );
  return { ...state, modes, options };
}

function withOptions(state: Conversation, options: Conversation["options"]): Conversation {
  const mode = options.find((option) => option.category === "mode");
  const current = mode?.type === "select" ? mode.currentValue : null;
  const modes = state.modes !== null && current !== null ? { ...state.modes, current } : state.modes;
  return { ...state, options, modes };
}

function sessionInfo(state: Conversation, update: Update<"session_info_update">): Conversation {
  const titled = update.title === undefined ? state : { ...state, title: update.title };
  const turn = turnOf(update._meta);
  if (turn?.state === "running") {
    return { ...titled, turn: { id: turn.id, cancelling: titled.turn?.cancelling ?? false } };
  }
  return turn === null ? titled : endTurn(titled, turn.stopReason ?? "end_turn");
}

/** Ends the turn. A normal end gets no note, and neither does a take-over, which has its own. */
function endTurn(state: Conversation, stopReason: string): Conversation {
  const over: Conversation = { ...withPlanOver(state), turn: null };
  const last = state.items.at(-1);
  if (stopReason === "end_turn" || (last?.kind === "note" && last.takenBy !== undefined)) return over;
  return add<NoteItem>(over, { kind: "note", stopReason, error: null });
}

function withPlanOver(state: Conversation): Conversation {
  const index = state.items.findLastIndex(({ kind }) => kind === "plan" || kind === "user");
  const plan = state.items[index];
  return plan?.kind === "plan" ? replaceAt(state, index, { ...plan, over: true }) : state;
}

/** The person here sent a prompt, at `at` in Unix seconds. The agent does not send it back to this connection. */
export function promptSent(
  state: Conversation,
  text: string,
  author: string,
  at: number | null = null,
): Conversation {
  const timeline = at === null ? state.timeline : startTimeline(at, null);
  const running: Conversation = { ...state, turn: { id: null, cancelling: false }, timeline };
  const blocks: ContentBlock[] = [{ type: "text", text }];
  return add<UserItem>(running, { kind: "user", author, turnId: null, blocks, unconfirmed: true });
}

const isUnconfirmed = (item: Item): item is UserItem => item.kind === "user" && item.unconfirmed === true;

/** The agent has all prompts that were sent from here. */
function confirmed(state: Conversation): Conversation {
  if (!state.items.some(isUnconfirmed)) return state;
  return {
    ...state,
    items: state.items.map((item) => {
      if (!isUnconfirmed(item)) return item;
      const { unconfirmed: _, ...known } = item;
      return known;
    }),
  };
}

/** The conversation as the agent surely has it: from its last event on it can be resumed. */
export function withoutUnconfirmed(state: Conversation): Conversation {
  const items = state.items.filter((item) => !isUnconfirmed(item));
  return items.length === state.items.length ? state : { ...state, items, turn: null, timeline: null };
}

/** The prompts of `before`, the texts of which the agent did not get: they are not in `after`, which it has sent since. */
export function lostPrompts(before: Conversation, after: Conversation): UserItem[] {
  return before.items.filter(isUnconfirmed).filter((prompt) => {
    const count = ({ items }: Conversation): number =>
      items.filter((item) => item.kind === "user" && !isUnconfirmed(item) && sameWords(item, prompt)).length;
    if (before.dropped === 0 && after.dropped === 0) return count(after) <= count(before);
    const last = after.items.findLast((item) => item.kind === "user");
    return last?.kind !== "user" || !sameWords(last, prompt);
  });
}

function sameWords(one: UserItem, other: UserItem): boolean {
  return one.author === other.author && JSON.stringify(one.blocks) === JSON.stringify(other.blocks);
}

/** The answer to the prompt came. Where the agent announced the end of the turn before, nothing changes. */
export function promptEnded(state: Conversation, stopReason: string, at: number | null = null): Conversation {
  const known = confirmed(state);
  const over = at === null ? known : { ...known, timeline: endTimeline(state.timeline, at) };
  return state.turn === null ? over : endTurn(over, stopReason);
}

/** The agent refused the prompt, so no turn runs. */
export function promptFailed(state: Conversation, error: string): Conversation {
  return add<NoteItem>(
    { ...confirmed(state), turn: null, timeline: null },
    { kind: "note", stopReason: null, error },
  );
}

export function cancelRequested(state: Conversation): Conversation {
  return state.turn === null ? state : { ...state, turn: { ...state.turn, cancelling: true } };
}

/** Applies the answer to `session/new` or `session/load`: the settings, and whether a turn runs. */
export function sessionOpened(
  state: Conversation,
  answer: NewSessionResponse | LoadSessionResponse,
): Conversation {
  const turn = turnOf(answer._meta);
  const modes = answer.modes;
  return {
    ...state,
    turn: turn?.state === "running" ? { id: turn.id, cancelling: state.turn?.cancelling ?? false } : null,
    modes: modes ? { current: modes.currentModeId, available: modes.availableModes } : state.modes,
    options: answer.configOptions ?? state.options,
    remembered: rememberedOf(answer._meta) ?? state.remembered,
  };
}
