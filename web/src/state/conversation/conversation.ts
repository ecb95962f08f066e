/** A session as the screen shows it: plain immutable data, made by the reducer alone. */
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

/** Whether a tool call with this status is over. */
export function hasEnded(status: ToolStatus | null | undefined): boolean {
  return status === "completed" || status === "failed";
}

export interface UserItem {
  kind: "user";
  key: string;
  author: string | null;
  turnId: string | null;
  blocks: ContentBlock[];
  /** True for a prompt of the person here as long as nothing shows that the agent has it. */
  unconfirmed?: boolean;
}

/** What the agent thinks or says: text that grows, and pictures, sounds and links. */
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
  /** True once its turn has ended: a step that is not completed by then has failed or was not reached. */
  over?: boolean;
}

export interface ToolItem {
  kind: "tool";
  key: string;
  id: string;
  title: string;
  /** The tool's own name; null where the agent does not send it. For summaries only. */
  tool: string | null;
  status: ToolStatus;
  content: ToolCallContent[];
  input: unknown;
  output: unknown;
  progress: Progress | null;
  /** What the call waits for before it begins; null when it waits for nothing. */
  waiting: Waiting | null;
  decision: Decision | null;
}

/** How a turn ended, unless it ended normally, or why a prompt was refused. */
export interface NoteItem {
  kind: "note";
  key: string;
  stopReason: string | null;
  /** Who took control of the robot; absent when nobody did. */
  takenBy?: string;
  error: string | null;
}

export type Item = UserItem | AgentItem | PlanItem | ToolItem | NoteItem;

export interface Turn {
  id: string | null;
  /** True from the moment somebody here asked to cancel until the turn has ended. */
  cancelling: boolean;
}

export interface Modes {
  current: string;
  available: SessionMode[];
}

export interface Conversation {
  items: Item[];
  /** How many earlier items were dropped; the session's log still has them. */
  dropped: number;
  /** The turn that runs; null while none does. */
  turn: Turn | null;
  /** The number of the last update that was applied; one that is not newer is ignored. */
  lastSeq: number;
  /** How many items were ever created. Keys are counted, so that a replay gives the same ones. */
  made: number;
  title: string | null;
  modes: Modes | null;
  options: SessionConfigOption[];
  /** Tools whose answer counts for the rest of the session: true for allowed, false for refused. */
  remembered: Record<string, boolean>;
  /** The timeline of the running turn, else of the last one; null before the first. */
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
