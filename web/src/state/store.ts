/**
 * All that the page knows, in one place. `acp/` writes what comes from the bridge, components only what a person hides
 * or dismisses. A conversation that is being replayed stays in `drafts` until it is complete, so that the screen never
 * flashes empty.
 */
import type { PermissionOption, RequestPermissionResponse, SessionInfo } from "@agentclientprotocol/sdk";
import { create } from "zustand";
import type { Abilities } from "../wire/abilities";
import type { Preview } from "../wire/meta";
import type { Person } from "../wire/people";
import type { Stop, Telemetry } from "../wire/telemetry";
import { EMPTY, type Conversation } from "./conversation/conversation";
import type { LinkState } from "../wire/link-state";
import type { Health, Me } from "../wire/bridge";

/** A permission request of the agent. Kept until it is answered, withdrawn or decided by somebody else. */
export interface Question {
  key: string;
  sessionId: string;
  toolCallId: string;
  /** The tool's own name; null where the agent does not send it. */
  tool: string | null;
  title: string;
  /** Who asked for what the call does. */
  asker: string | null;
  /** What an answer for the whole session would count for, in words. */
  subject: string | null;
  /** The arguments of the call. */
  input: unknown;
  /** What the call would do; null where the robot has not computed it. */
  preview: Preview | null;
  options: PermissionOption[];
  /** Milliseconds of this machine's clock; null when there is no time limit. */
  expiresAt: number | null;
  /** How long the question is open to answers in all, in s. */
  timeoutS: number | null;
  answer: (response: RequestPermissionResponse) => void;
}

export interface Toast {
  id: number;
  tone: "info" | "warning";
  text: string;
  /** The language of a sentence that is not the page's own. */
  lang: string | undefined;
}

/** The alerts that the person here has read and hidden. */
export interface HiddenAlerts {
  /** `at` of the halt; null when none was hidden. */
  halted: number | null;
  /** The level at which it was hidden; null when it was not. */
  battery: number | null;
}

/**
 * Why Stop failed: nothing answered; something else than the robot's server did; the server refused, and says why; or it
 * could not reach the robot, and says what to do.
 */
export type StopFailure =
  { kind: "noAnswer" } | { kind: "foreign" } | { kind: "refused" | "told"; sentence: string };

/** Why nobody is logged in. */
export type LoginProblem = "none" | "invalid" | "tooMany" | "expired" | "unreachable";

export type Auth =
  { status: "checking" } | { status: "out"; problem: LoginProblem } | { status: "in"; me: Me };

export interface State {
  auth: Auth;
  link: LinkState;
  /** Null until the first answer. */
  health: Health | null;
  /** False while the bridge does not answer over HTTP. */
  reachable: boolean;
  /** The last round trip to the bridge over HTTP, in ms; null while nothing answers. */
  latencyMs: number | null;
  /** Server clock minus this machine's, in ms. */
  clockOffsetMs: number;
  /** Whether the agent can delete sessions. */
  canDelete: boolean;
  /** Whether the agent can send the events of a session from a number on, in place of all of them. */
  canResume: boolean;

  sessions: SessionInfo[];
  /** The cursor of the next page of sessions; null when all are loaded. */
  moreSessions: string | null;
  /** False until the agent has listed its sessions. */
  sessionsKnown: boolean;
  /** The answer to the last search; `more` is the cursor of its next page. Null while there is no search. */
  found: { words: string; sessions: SessionInfo[]; more: string | null } | null;
  /** Who is connected; null where the agent does not say. */
  people: Person[] | null;

  /** The session on the screen. */
  currentId: string | null;
  /** True from choosing a session until it can be used. */
  opening: boolean;
  /** Why the session on the screen could not be opened, in the agent's words; null where it could, or was not tried. */
  notOpened: string | null;
  conversations: Record<string, Conversation>;
  /** Conversations that are being replayed. */
  drafts: Record<string, Conversation>;
  /** Sessions whose updates this connection receives. */
  attached: ReadonlySet<string>;

  questions: Question[];
  /** What the robot can do; null until a screen has asked for it. */
  abilities: Abilities | null;
  telemetry: Telemetry | null;
  /**
   * Since when nothing has come from the robot, in Unix seconds by the agent's clock: its telemetry has stopped, or the
   * connection is lost. Null while telemetry comes, and with an agent that sends none.
   */
  silentSince: number | null;
  /** The stop that holds, as Stop and Release answered over HTTP, until newer telemetry comes. */
  stop: Stop | null;
  /** True while Stop waits for its answer. */
  stopBusy: boolean;
  /** Null where Stop did not fail. Shown loudly. */
  stopError: StopFailure | null;
  toasts: Toast[];
  /** Alerts that the person here has hidden. */
  hidden: HiddenAlerts;
}

export const INITIAL: State = {
  auth: { status: "checking" },
  link: { status: "off" },
  health: null,
  reachable: true,
  latencyMs: null,
  clockOffsetMs: 0,
  canDelete: false,
  canResume: false,
  sessions: [],
  moreSessions: null,
  sessionsKnown: false,
  found: null,
  people: null,
  currentId: null,
  opening: false,
  notOpened: null,
  conversations: {},
  drafts: {},
  attached: new Set(),
  questions: [],
  abilities: null,
  telemetry: null,
  silentSince: null,
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

/** The robot's name: from the login, else from telemetry, else from the bridge. */
export function robotName(state: State): string {
  if (state.auth.status === "in" && state.auth.me.robot !== "") return state.auth.me.robot;
  return state.telemetry?.robot ?? state.health?.robotName ?? "Robot";
}

/** Counts toasts, for their ids. */
let toastCount = 0;

/** Shows a short notice; the oldest of more than three goes. `lang` is the language of a sentence that is not the page's. */
export function toast(tone: Toast["tone"], text: string, lang?: string): void {
  const id = ++toastCount;
  setState((state) => ({ toasts: [...state.toasts.slice(-2), { id, tone, text, lang }] }));
}
