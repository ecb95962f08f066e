/** What the robot is doing for the visitor, as one of a fixed list: computed from the store, never stored. */
import type { Telemetry } from "../../wire/telemetry";
import { callText, untranslatedPart } from "../../i18n/agent-terms";
import type { Conversation, Item, ToolItem } from "../../state/conversation/conversation";
import { isCutOff, type LinkState } from "../../wire/link-state";
import { asString, isRecord } from "../../wire/fields";

export type RobotActivity =
  | { kind: "nothing" }
  | { kind: "offline" }
  | { kind: "unreachable" }
  /** The robot works for somebody else, and nobody here has asked for anything yet. */
  | { kind: "elsewhere" }
  /** `says`: the sentence that the robot wants to speak, or null; else `what` it wants to do, with the part that is `untranslated`. */
  | { kind: "permission"; what: string; says: string | null; untranslated: string }
  | { kind: "queue" }
  | { kind: "driving"; place: string | null; metres: number | null; seconds: number | null }
  | { kind: "turning" }
  | { kind: "speaking"; text: string }
  | { kind: "photo" }
  /** A tool for which the kiosk has no text of its own. */
  | { kind: "tool"; what: string }
  | { kind: "thinking" };

/** The visitor's last request and everything that came after it. */
export function exchange(conversation: Conversation): Item[] {
  const request = conversation.items.findLastIndex((item) => item.kind === "user");
  return request < 0 ? [] : conversation.items.slice(request);
}

export function robotActivity(
  link: LinkState,
  telemetry: Telemetry | null,
  silentSince: number | null,
  conversation: Conversation,
  sessionId: string | null,
): RobotActivity {
  if (isCutOff(link)) return { kind: "offline" };
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
      untranslated: untranslatedPart(tool),
    };
  if (tool?.status === "pending" && tool.waiting === "robot") return { kind: "queue" };
  return tool?.status === "in_progress" ? activityOf(tool, telemetry) : { kind: "thinking" };
}

function activityOf(tool: ToolItem, telemetry: Telemetry | null): RobotActivity {
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
      return { kind: "thinking" }; // over before a text about it could be read
    default:
      return { kind: "tool", what: callText(tool) };
  }
}

/** The parts of the large line and of the detail below it that are not in the page's language. */
export function untranslatedIn(activity: RobotActivity): { line: string; detail: string } {
  switch (activity.kind) {
    case "permission":
      return { line: "", detail: activity.says ?? activity.untranslated };
    case "speaking":
      return { line: activity.text, detail: "" };
    case "tool":
      return { line: activity.what, detail: "" };
    default:
      return { line: "", detail: "" };
  }
}

function sentenceOf(tool: ToolItem): string | null {
  return tool.tool === "speak" && isRecord(tool.input) ? asString(tool.input["text"]) : null;
}
