/**
 * The events of a session as rows for people: what kind, and a line of text. A row is small, whatever its event holds,
 * and the log keeps at most `MOST` of them; the events themselves stay with the agent.
 */
import type { ContentBlock, ToolCallContent } from "@agentclientprotocol/sdk";
import type { Event } from "../acp/events/event-feed";
import { authorOf, decisionOf, progressOf, toolOf, turnOf, waitingOf } from "../wire/meta";
import { callWords, modeName, othersWords, settingName, type Call } from "../i18n/agent-terms";
import { hasEnded } from "./conversation/conversation";

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
  /** Where what is not the page's begins in the text: it may be in any language. */
  othersAt: number;
}

type Said = Pick<Row, "text" | "othersAt">;

/** Titles of tool calls that have not ended, by their ids: what follows a call does not repeat its title. */
export type Titles = Map<string, Said>;

export function rowOf({ seq, at, update }: Event, titles: Titles): Row {
  const [kind, { text, othersAt }] = told(update, titles);
  const ends = update.sessionUpdate === "tool_call_update" && hasEnded(update.status);
  if (ends) titles.delete(update.toolCallId); // else a log that is looked at for days keeps those of every call
  const line = inOneLine(text).trim();
  const short = line.length > LONGEST ? `${line.slice(0, LONGEST - 1)}…` : line;
  const own = inOneLine(text.slice(0, othersAt)).trimStart();
  return { seq, at, kind, text: short, othersAt: Math.min(own.length, short.length) };
}

function told(update: Event["update"], titles: Titles): [Kind, Said] {
  switch (update.sessionUpdate) {
    case "user_message_chunk":
      return ["asked", after(ours(authorOf(update._meta)), theirs(blockText(update.content)))];
    case "agent_message_chunk":
      return ["said", theirs(blockText(update.content))];
    case "agent_thought_chunk":
      return ["thought", theirs(blockText(update.content))];
    case "plan":
      return ["plan", theirs(update.entries.map(({ content }) => content).join(" · "))];
    case "tool_call": {
      const title = titleOf({ tool: toolOf(update._meta), input: update.rawInput, title: update.title });
      titles.set(update.toolCallId, title);
      return [update.status === "in_progress" ? "begun" : "tool", title];
    }
    case "tool_call_update": {
      const title = update.title != null ? theirs(update.title) : (titles.get(update.toolCallId) ?? ours(""));
      const words = theirs(contentText(update.content ?? []));
      const decision = decisionOf(update._meta);
      if (decision !== null) {
        const allowed = decision.reason !== "timeout" && decision.option?.startsWith("allow") === true;
        return [allowed ? "allowed" : "refused", after(ours(decision.by), title)];
      }
      const waiting = waitingOf(update._meta);
      if (waiting !== null) return [waiting === "robot" ? "queued" : "question", title];
      if (progressOf(update._meta) !== null) return ["progress", after(title, words)];
      if (update.status === "completed") return ["done", title];
      if (update.status === "failed") return ["failed", after(title, words)];
      return [update.status === "in_progress" ? "begun" : "tool", title];
    }
    case "current_mode_update":
      return ["mode", ours(modeName(update.currentModeId))];
    case "config_option_update":
      return ["settings", ours(update.configOptions.map(({ id, name }) => settingName(id, name)).join(", "))];
    case "session_info_update": {
      const turn = turnOf(update._meta);
      if (turn?.state === "ended") return ["ended", ours(turn.stopReason ?? "")];
      return typeof update.title === "string" ? ["named", theirs(update.title)] : ["forked", ours("")];
    }
    case "usage_update":
      return ["usage", ours(`${update.used}${update.size > 0 ? ` / ${update.size}` : ""}`)];
    default:
      return ["other", ours("")];
  }
}

const ours = (text: string | null): Said => ({ text: text ?? "", othersAt: text?.length ?? 0 });
const theirs = (text: string): Said => ({ text, othersAt: 0 });

function titleOf(call: Call): Said {
  const text = callWords(call);
  const others = othersWords(call);
  return { text, othersAt: others === "" ? text.length : text.lastIndexOf(others) };
}

function after(first: Said, second: Said): Said {
  if (first.text === "") return second;
  if (second.text === "") return first;
  const start = `${first.text}: `;
  const mixed = first.othersAt < first.text.length;
  return { text: start + second.text, othersAt: mixed ? first.othersAt : start.length + second.othersAt };
}

function inOneLine(text: string): string {
  return text.replace(/\s+/g, " ");
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
