/**
 * The events of a session as rows for people: the kind of event, and a line of text. A row is small, whatever its event
 * contains, and the log keeps at most `MAX_ROWS` of them; the events themselves stay with the agent.
 */
import type { ContentBlock, ToolCallContent } from "@agentclientprotocol/sdk";
import type { NumberedEvent } from "../wire/event";
import { authorOf, decisionOf, progressOf, toolOf, turnOf, waitingOf } from "../wire/meta";
import { callText, modeName, untranslatedPart, settingName, type Call } from "../i18n/agent-terms";
import { hasEnded } from "./conversation/conversation";
import { visibleLine } from "../wire/visible-text";

export const MAX_ROWS = 10_000;
/** Characters of a row's text. */
const MAX_TEXT = 200;

/** Rows of a page. */
export const PAGE = 100;
/** The newest page grows up to so many rows while somebody reads in it. */
export const LONGEST_PAGE = 500;

export type Filter = "talk" | "thoughts" | "tools" | "permissions" | "system";

export const FILTERS: readonly Filter[] = ["talk", "thoughts", "tools", "permissions", "system"];

/** The kinds of rows, each with the filter that it belongs to. */
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
  /** The index in `text` from which on the words are not the page's own: they may be in any language. */
  foreignFrom: number;
}

type RowText = Pick<Row, "text" | "foreignFrom">;

/** Titles of tool calls that have not ended, by their ids: the updates of a call do not repeat its title. */
export type Titles = Map<string, RowText>;

export function rowOf({ seq, at, update }: NumberedEvent, titles: Titles): Row {
  const [kind, { text, foreignFrom }] = describe(update, titles);
  const ends = update.sessionUpdate === "tool_call_update" && hasEnded(update.status);
  if (ends) titles.delete(update.toolCallId); // otherwise a log that is open for days keeps the title of every call
  const line = visibleLine(inOneLine(text).trim());
  const short = line.length > MAX_TEXT ? `${line.slice(0, MAX_TEXT - 1)}…` : line;
  const own = visibleLine(inOneLine(text.slice(0, foreignFrom)).trimStart());
  return { seq, at, kind, text: short, foreignFrom: Math.min(own.length, short.length) };
}

function describe(update: NumberedEvent["update"], titles: Titles): [Kind, RowText] {
  switch (update.sessionUpdate) {
    case "user_message_chunk":
      return ["asked", joinTexts(pageText(authorOf(update._meta)), foreignText(blockText(update.content)))];
    case "agent_message_chunk":
      return ["said", foreignText(blockText(update.content))];
    case "agent_thought_chunk":
      return ["thought", foreignText(blockText(update.content))];
    case "plan":
      return ["plan", foreignText(update.entries.map(({ content }) => content).join(" · "))];
    case "tool_call": {
      const title = titleOf({ tool: toolOf(update._meta), input: update.rawInput, title: update.title });
      titles.set(update.toolCallId, title);
      return [update.status === "in_progress" ? "begun" : "tool", title];
    }
    case "tool_call_update": {
      const title =
        update.title != null ? foreignText(update.title) : (titles.get(update.toolCallId) ?? pageText(""));
      const words = foreignText(contentText(update.content ?? []));
      const decision = decisionOf(update._meta);
      if (decision !== null) {
        const allowed = decision.reason !== "timeout" && decision.option?.startsWith("allow") === true;
        return [allowed ? "allowed" : "refused", joinTexts(pageText(decision.by), title)];
      }
      const waiting = waitingOf(update._meta);
      if (waiting !== null) return [waiting === "robot" ? "queued" : "question", title];
      if (progressOf(update._meta) !== null) return ["progress", joinTexts(title, words)];
      if (update.status === "completed") return ["done", title];
      if (update.status === "failed") return ["failed", joinTexts(title, words)];
      return [update.status === "in_progress" ? "begun" : "tool", title];
    }
    case "current_mode_update":
      return ["mode", pageText(modeName(update.currentModeId))];
    case "config_option_update":
      return [
        "settings",
        pageText(update.configOptions.map(({ id, name }) => settingName(id, name)).join(", ")),
      ];
    case "session_info_update": {
      const turn = turnOf(update._meta);
      if (turn?.state === "ended") return ["ended", pageText(turn.stopReason ?? "")];
      return typeof update.title === "string"
        ? ["named", foreignText(update.title)]
        : ["forked", pageText("")];
    }
    case "usage_update":
      return ["usage", pageText(`${update.used}${update.size > 0 ? ` / ${update.size}` : ""}`)];
    default:
      return ["other", pageText("")];
  }
}

/** Words of the page's own. */
const pageText = (text: string | null): RowText => ({ text: text ?? "", foreignFrom: text?.length ?? 0 });
/** Words of a person, a model or a tool. */
const foreignText = (text: string): RowText => ({ text, foreignFrom: 0 });

function titleOf(call: Call): RowText {
  const text = callText(call);
  const foreign = untranslatedPart(call);
  return { text, foreignFrom: foreign === "" ? text.length : text.lastIndexOf(foreign) };
}

/** Both texts with a colon between them. */
function joinTexts(first: RowText, second: RowText): RowText {
  if (first.text === "") return second;
  if (second.text === "") return first;
  const start = `${first.text}: `;
  const mixed = first.foreignFrom < first.text.length;
  return {
    text: start + second.text,
    foreignFrom: mixed ? first.foreignFrom : start.length + second.foreignFrom,
  };
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

/** The rows of these filters that contain all the words; `nameOf` gives the kind in words. */
export function filterRows(
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

/** The index of the page's first row: the row of event number `from`, or the start of the newest page. */
export function startOf(rows: readonly Row[], from: number | null): number {
  const newest = Math.max(0, rows.length - PAGE);
  if (from === null) return newest;
  const found = rows.findIndex(({ seq }) => seq >= from);
  return found < 0 ? newest : found;
}

/** At most `length` rows, from event number `from` on, or the newest ones. */
export function pageOf(rows: readonly Row[], from: number | null, length: number): readonly Row[] {
  const start = startOf(rows, from);
  return rows.slice(start, start + length);
}

/** As in `sancho-2026-11-21-go-to-lab-2-3-7.jsonl`: plain letters, so that every file system accepts it. */
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
