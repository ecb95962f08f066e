/**
 * All that the page knows, in one place. Only `acp/` and `api/` actions write to it; components read.
 * A conversation that is being replayed stays in `drafts` until it is complete, so that the screen never flashes empty.
 */
import type { PermissionOption, RequestPermissionResponse, SessionInfo } from "@agentclientprotocol/sdk";
import { create } from "zustand";
import type { Abilities } from "../wire/abilities";
import type { LinkState } from "../acp/connection/link";
import type { Preview } from "../wire/meta";
import type { Person } from "../wire/people";
import type { Stop, Telemetry } from "../wire/telemetry";
import type { Health, Me } from "../api/http";
import type { Hidden } from "./alerts";
import { EMPTY, type Conversation } from "./conversation/conversation";

/** Somebody has to decide. Kept until it is answered, withdrawn or decided by somebody else. */
export interface Question {
  key: string;
  sessionId: string;
  toolCallId: string;
  /** The tool's own name, where the agent tells it. */
  tool: string | null;
  title: string;
  asker: string | null;
  /** What an answer for the whole session would count for, in words. */
  subject: string | null;
  /** The arguments of the call. */
  input: unknown;
  /** What it would do, where the robot has computed that. */
  preview: Preview | null;
  options: PermissionOption[];
  /** Milliseconds of this machine's clock; null when there is no time limit. */
  expiresAt: number | null;
  /** How long it was open to answers in all, in s. */
  timeoutS: number | null;
  answer: (response: RequestPermissionResponse) => void;
}

export interface Toast {
  id: number;
  tone: "info" | "danger";
  text: string;
  /** Of a sentence that is not the page's. */
  lang: string | undefined;
}

/** Why nobody is in. */
export type LoginProblem = "none" | "invalid" | "expired" | "unreachable";

export type Auth =
  { status: "checking" } | { status: "out"; problem: LoginProblem } | { status: "in"; me: Me };

export interface State {
  auth: Auth;
  link: LinkState;
  /** Null until the first answer. `reachable` is false while nothing answers over HTTP. */
  health: Health | null;
  reachable: boolean;
  latencyMs: number | null;
  /** Server clock minus this machine's, in ms. */
  clockOffsetMs: number;
  canDelete: boolean;

  sessions: SessionInfo[];
  /** Where the next page of sessions begins; null when all are here. */
  moreSessions: string | null;
  sessionsKnown: boolean;
  /** The answer to the last search; `more` is where its next page begins. Null while nothing is looked for. */
  found: { words: string; sessions: SessionInfo[]; more: string | null } | null;
  /** Who is connected; null where nobody tells. */
  people: Person[] | null;

  currentId: string | null;
  /** True from choosing a session until it can be used. */
  opening: boolean;
  conversations: Record<string, Conversation>;
  drafts: Record<string, Conversation>;
  /** Sessions whose updates this connection receives. */
  attached: ReadonlySet<string>;

  questions: Question[];
  /** What the robot can do, where a screen asked for that; null until it is known. */
  abilities: Abilities | null;
  telemetry: Telemetry | null;
  /**
   * Up to when the robot was heard, in Unix seconds by the agent's clock: its telemetry has ceased, or the connection is
   * lost. Null while it is heard, and where nobody tells of it.
   */
  heardUntil: number | null;
  /** What Stop and Release answered over HTTP, until telemetry knows better. */
  stop: Stop | null;
  stopBusy: boolean;
  /** Why Stop did not get through, as the server says it; empty where it says nothing. Shown loudly. */
  stopError: string | null;
  toasts: Toast[];
  /** Alerts that the person here has read. */
  hidden: Hidden;
}

export const INITIAL: State = {
  auth: { status: "checking" },
  link: { status: "off" },
  health: null,
  reachable: true,
  latencyMs: null,
  clockOffsetMs: 0,
  canDelete: false,
  sessions: [],
  moreSessions: null,
  sessionsKnown: false,
  found: null,
  people: null,
  currentId: null,
  opening: false,
  conversations: {},
  drafts: {},
  attached: new Set(),
  questions: [],
  abilities: null,
  telemetry: null,
  heardUntil: null,
  stop: null,
  stopBusy: false,
  stopError: null,
  toasts: [],
  hidden: { halted: null, battery: null },
};

export const useStore = create<State>(() => INITIAL);

export const { getState, setState } = useStore;

/** The conversation on the screen. */
export function conversationOf({ currentId, conversations }: State): Conversation {
  return currentId === null ? EMPTY : (conversations[currentId] ?? EMPTY);
}

export function useMe(): Me {
  const auth = useStore((state) => state.auth);
  if (auth.status !== "in") throw new Error("nobody is logged in");
  return auth.me;
}

/** The robot's name, from whoever knows it. */
export function robotName(state: State): string {
  if (state.auth.status === "in" && state.auth.me.robot !== "") return state.auth.me.robot;
  return state.telemetry?.robot ?? state.health?.robotName ?? "Robot";
}

let toasts = 0;

export function toast(tone: Toast["tone"], text: string, lang?: string): void {
  const id = ++toasts;
  setState((state) => ({ toasts: [...state.toasts.slice(-2), { id, tone, text, lang }] }));
}
