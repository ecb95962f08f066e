/**
 * The events of a session as rows for people: what kind, and a line of text. A row is small, whatever its event holds,
 * and the log keeps at most `MOST` of them; the events themselves stay with the agent.
 */
import type { ContentBlock, ToolCallContent } from "@agentclientprotocol/sdk";
import type { Event } from "../acp/events";
import { authorOf, decisionOf, progressOf, toolOf, turnOf, waitingOf } from "../acp/meta";
import { callWords, modeName, settingName } from "../i18n/known";
import { hasEnded } from "./conversation";

export const MOST = 10_000;
const LONGEST = 200;

export const PAGE = 100;
/** The newest page grows so far while somebody reads in it. */
export const LONGEST_PAGE = 500;

export type Filter = "talk" | "thoughts" | "tools" | "permissions" | "system";

export const FILTERS: readonly Filter[] = ["talk", "thoughts", "tools", "permissions", "system"];

/** What happened, and where it belongs. */
export const KINDS = {
  asked: "talk",
  said: "talk",
  thought: "thoughts",
  plan: "thoughts",
  tool: "tools",
  begun: "tools",
  progress: "tools",
  done: "tools",
  failed: "tools",
  queued: "tools",
  question: "permissions",
  allowed: "permissions",
  refused: "permissions",
  mode: "system",
  settings: "system",
  named: "system",
  ended: "system",
  forked: "system",
  usage: "system",
  other: "system",
} as const satisfies Record<string, Filter>;

export type Kind = keyof typeof KINDS;

export interface Row {
  seq: number;
  /** Unix seconds. */
  at: number;
  kind: Kind;
  text: string;
}

/** Titles of tool calls that have not ended, by their ids: what follows a call does not repeat its title. */
export type Titles = Map<string, string>;

export function rowOf({ seq, at, update }: Event, titles: Titles): Row {
  const [kind, text] = told(update, titles);
  const ends = update.sessionUpdate === "tool_call_update" && hasEnded(update.status);
  if (ends) titles.delete(update.toolCallId); // else a log that is looked at for days keeps those of every call
  const line = text.replace(/\s+/g, " ").trim();
  return { seq, at, kind, text: line.length > LONGEST ? `${line.slice(0, LONGEST - 1)}…` : line };
}

function told(update: Event["update"], titles: Titles): [Kind, string] {
  switch (update.sessionUpdate) {
    case "user_message_chunk":
      return ["asked", after(authorOf(update._meta), blockText(update.content))];
    case "agent_message_chunk":
      return ["said", blockText(update.content)];
    case "agent_thought_chunk":
      return ["thought", blockText(update.content)];
    case "plan":
      return ["plan", update.entries.map(({ content }) => content).join(" · ")];
    case "tool_call": {
      const title = callWords({ tool: toolOf(update._meta), input: update.rawInput, title: update.title });
      titles.set(update.toolCallId, title);
      return [update.status === "in_progress" ? "begun" : "tool", title];
    }
    case "tool_call_update": {
      const title = update.title ?? titles.get(update.toolCallId) ?? "";
      const words = contentText(update.content ?? []);
      const decision = decisionOf(update._meta);
      if (decision !== null) {
        const allowed = decision.reason !== "timeout" && decision.option?.startsWith("allow") === true;
        return [allowed ? "allowed" : "refused", after(decision.by, title)];
      }
      const waiting = waitingOf(update._meta);
      if (waiting !== null) return [waiting === "robot" ? "queued" : "question", title];
      if (progressOf(update._meta) !== null) return ["progress", after(title, words)];
      if (update.status === "completed") return ["done", title];
      if (update.status === "failed") return ["failed", after(title, words)];
      return [update.status === "in_progress" ? "begun" : "tool", title];
    }
    case "current_mode_update":
      return ["mode", modeName(update.currentModeId)];
    case "config_option_update":
      return ["settings", update.configOptions.map(({ id, name }) => settingName(id, name)).join(", ")];
    case "session_info_update": {
      const turn = turnOf(update._meta);
      if (turn?.state === "ended") return ["ended", turn.stopReason ?? ""];
      return typeof update.title === "string" ? ["named", update.title] : ["forked", ""];
    }
    case "usage_update":
      return ["usage", `${update.used}${update.size > 0 ? ` / ${update.size}` : ""}`];
    default:
      return ["other", ""];
  }
}

function after(first: string | null, second: string): string {
  return [first ?? "", second].filter((part) => part !== "").join(": ");
}

function blockText(block: ContentBlock): string {
  return block.type === "text" ? block.text : block.type === "resource_link" ? block.name : `[${block.type}]`;
}

function contentText(content: ToolCallContent[]): string {
  return content.map((part) => (part.type === "content" ? blockText(part.content) : "")).join(" ");
}

/** The rows of these kinds in which all the words stand; `nameOf` is a kind in words. */
export function matching(
  rows: readonly Row[],
  kinds: ReadonlySet<Filter>,
  words: string,
  nameOf: (kind: Kind) => string,
): readonly Row[] {
  const wanted = words.toLocaleLowerCase().split(/\s+/).filter(Boolean);
  if (wanted.length === 0 && kinds.size === FILTERS.length) return rows;
  return rows.filter((row) => {
    if (!kinds.has(KINDS[row.kind])) return false;
    if (wanted.length === 0) return true;
    const text = `${nameOf(row.kind)} ${row.text}`.toLocaleLowerCase();
    return wanted.every((word) => text.includes(word));
  });
}

/** The index at which a page begins: that of number `from`, or that of the newest page. */
export function startOf(rows: readonly Row[], from: number | null): number {
  const newest = Math.max(0, rows.length - PAGE);
  if (from === null) return newest;
  const found = rows.findIndex(({ seq }) => seq >= from);
  return found < 0 ? newest : found;
}

/** At most `length` rows, from number `from` on, or the newest ones. */
export function pageOf(rows: readonly Row[], from: number | null, length: number): readonly Row[] {
  const start = startOf(rows, from);
  return rows.slice(start, start + length);
}

/** As in `sancho-2026-11-21-go-to-lab-2-3-7.jsonl`: plain letters, so that every system takes it. */
export function fileName(robot: string, title: string | null, sessionId: string, day: Date): string {
  const name = plain(title ?? "").slice(0, 40);
  const date = [day.getFullYear(), day.getMonth() + 1, day.getDate()].map((n) => String(n).padStart(2, "0"));
  return [plain(robot), ...date, name || plain(sessionId).slice(0, 8)].filter(Boolean).join("-") + ".jsonl";
}

function plain(text: string): string {
  return text
    .normalize("NFKD")
    .replace(/\p{M}/gu, "")
    .toLowerCase()
    .replace(/[^a-z0-9]+/g, "-")
    .replace(/^-+|-+$/g, "");
}
