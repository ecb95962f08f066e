/** What a session is on the screen: plain immutable data, made by the reducer alone. */
import type {
  ContentBlock,
  PlanEntry,
  SessionConfigOption,
  SessionMode,
  ToolCallContent,
} from "@agentclientprotocol/sdk";
import type { Decision, Progress, Waiting } from "../../wire/meta";
import type { Timeline } from "./timeline";

export type ToolStatus = "pending" | "in_progress" | "completed" | "failed";

/** Whether a tool call with this status is over: nothing more comes of it. */
export function hasEnded(status: ToolStatus | null | undefined): boolean {
  return status === "completed" || status === "failed";
}

export interface UserItem {
  kind: "user";
  key: string;
  author: string | null;
  turnId: string | null;
  blocks: ContentBlock[];
}

/** What the agent thinks or says: text that grows, and whatever else it shows. */
export interface AgentItem {
  kind: "thought" | "agent";
  key: string;
  messageId: string | null;
  text: string;
  blocks: ContentBlock[];
}

export interface PlanItem {
  kind: "plan";
  key: string;
  entries: PlanEntry[];
}

export interface ToolItem {
  kind: "tool";
  key: string;
  id: string;
  title: string;
  /** The tool's own name, where the agent tells it: for summaries only. */
  tool: string | null;
  status: ToolStatus;
  content: ToolCallContent[];
  input: unknown;
  output: unknown;
  progress: Progress | null;
  /** What it waits for before it begins. */
  waiting: Waiting | null;
  decision: Decision | null;
}

/** How a turn ended, where that is worth a line, or what went wrong with sending. */
export interface NoteItem {
  kind: "note";
  key: string;
  stopReason: string | null;
  /** Who took the robot over, where that is what happened. */
  takenBy?: string;
  error: string | null;
}

export type Item = UserItem | AgentItem | PlanItem | ToolItem | NoteItem;

export interface Turn {
  id: string | null;
  /** Set from the moment somebody here asked to cancel until the turn has ended. */
  cancelling: boolean;
}

export interface Modes {
  current: string;
  available: SessionMode[];
}

export interface Conversation {
  items: Item[];
  /** How many items came before these and are kept no more: the log of the session has them. */
  dropped: number;
  /** The turn that runs; null while none does. */
  turn: Turn | null;
  /** The number of the last update that is in here; what is not newer has been seen. */
  lastSeq: number;
  /** How many items have been made; keys are counted so that a replay gives the same ones. */
  made: number;
  title: string | null;
  modes: Modes | null;
  options: SessionConfigOption[];
  /** Tools for which an answer counts for the rest of the session: allowed, or refused. */
  remembered: Record<string, boolean>;
  /** What the turn that runs, or else the last one, spends its time on; null before the first. */
  timeline: Timeline | null;
}

export const EMPTY: Conversation = {
  items: [],
  dropped: 0,
  turn: null,
  lastSeq: 0,
  made: 0,
  title: null,
  modes: null,
  options: [],
  remembered: {},
  timeline: null,
};
