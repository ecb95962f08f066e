/** What the robot is robotActivity for the visitor, as one of a fixed list: computed from all that is known, never stored. */
import type { Telemetry } from "../../wire/telemetry";
import { callText, untranslatedPart } from "../../i18n/agent-terms";
import type { Conversation, Item, ToolItem } from "../../state/conversation/conversation";
import type { LinkState } from "../../wire/link-state";
import { asString, isRecord } from "../../wire/fields";

export type RobotActivity =
  | { kind: "nothing" }
  | { kind: "offline" }
  | { kind: "unreachable" }
  /** It works for somebody else, and nobody here has asked for anything yet. */
  | { kind: "elsewhere" }
  /** `says`: the sentence, where it wants to speak; else `what` it wants to do, with `others` in it. */
  | { kind: "permission"; what: string; says: string | null; others: string }
  | { kind: "queue" }
  | { kind: "driving"; place: string | null; metres: number | null; seconds: number | null }
  | { kind: "turning" }
  | { kind: "speaking"; text: string }
  | { kind: "photo" }
  /** A tool that has no words of its own here. */
  | { kind: "tool"; what: string }
  | { kind: "thinking" };

/** What came of the last thing that was asked for, and that itself. */
export function exchange(conversation: Conversation): Item[] {
  const asked = conversation.items.findLastIndex((item) => item.kind === "user");
  return asked < 0 ? [] : conversation.items.slice(asked);
}

export function robotActivity(
  link: LinkState,
  telemetry: Telemetry | null,
  silentSince: number | null,
  conversation: Conversation,
  sessionId: string | null,
): RobotActivity {
  if (link.status === "waiting" || (link.status === "connecting" && !link.first)) return { kind: "offline" };
  if (silentSince !== null || telemetry?.online === false) return { kind: "unreachable" };
  if (conversation.turn === null) {
    const holder = telemetry?.turn?.sessionId ?? null;
    return { kind: holder !== null && holder !== sessionId ? "elsewhere" : "nothing" };
  }
  const tool = exchange(conversation).findLast((item) => item.kind === "tool");
  if (tool?.status === "pending" && tool.waiting === "permission")
    return {
      kind: "permission",
      what: callText(tool),
      says: sentenceOf(tool),
      others: untranslatedPart(tool),
    };
  if (tool?.status === "pending" && tool.waiting === "robot") return { kind: "queue" };
  return tool?.status === "in_progress" ? working(tool, telemetry) : { kind: "thinking" };
}

function working(tool: ToolItem, telemetry: Telemetry | null): RobotActivity {
  const motion = telemetry?.motion ?? null;
  switch (tool.tool) {
    case "navigate_to_place":
    case "navigate_to_pose":
      return {
        kind: "driving",
        place: motion?.place ?? null,
        metres: motion?.distance ?? null,
        seconds: motion?.seconds ?? null,
      };
    case "rotate_in_place":
      return { kind: "turning" };
    case "take_photo":
      return { kind: "photo" };
    case "speak": {
      const text = telemetry?.speaking ?? sentenceOf(tool);
      return text === null ? { kind: "tool", what: callText(tool) } : { kind: "speaking", text };
    }
    case "get_topological_map":
    case "get_current_pose":
    case "get_robot_status":
      return { kind: "thinking" }; // a glance, over before it could be read
    default:
      return { kind: "tool", what: callText(tool) };
  }
}

/** What is not the page's in the one large line, and in the detail beside it. */
export function untranslatedIn(what: RobotActivity): { line: string; detail: string } {
  switch (what.kind) {
    case "permission":
      return { line: "", detail: what.says ?? what.others };
    case "speaking":
      return { line: what.text, detail: "" };
    case "tool":
      return { line: what.what, detail: "" };
    default:
      return { line: "", detail: "" };
  }
}

function sentenceOf(tool: ToolItem): string | null {
  return tool.tool === "speak" && isRecord(tool.input) ? asString(tool.input["text"]) : null;
}
