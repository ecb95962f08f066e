/**
 * The result of a tool call, in a sentence for people. For a tool that is not known here it is the text that the tool
 * gave; raw data are never a summary.
 */
import i18next from "../../i18n";
import { metres, percent, seconds } from "../../i18n/format";
import { isKnownCall } from "../../i18n/agent-terms";
import type { ToolItem } from "./conversation";
import { asNumber, asString, isRecord } from "../../wire/fields";

/** The status of a tool call, finer than ACP's four. */
export type Outcome = "pending" | "asking" | "in_progress" | "completed" | "failed" | "refused" | "cancelled";

export function outcomeOf(item: ToolItem, asking: boolean): Outcome {
  if (item.status !== "failed") return item.status === "pending" && asking ? "asking" : item.status;
  const { decision } = item;
  if (decision !== null) {
    if (decision.reason === "cancelled") return "cancelled";
    if (decision.reason !== "selected" || decision.option?.startsWith("allow") !== true) return "refused";
  }
  return textsOf(item).some((text) => /^cancell?ed\b/i.test(text)) ? "cancelled" : "failed";
}

export function textsOf(item: ToolItem): string[] {
  return item.content.flatMap((part) =>
    part.type === "content" && part.content.type === "text" ? [part.content.text.trim()] : [],
  );
}

export interface Summary {
  text: string;
  /** Absent for the page's own words; empty where the language is unknown. */
  lang?: "en" | "";
}

/** The sentence below the title; empty when title and outcome say everything. */
export function summaryOf(item: ToolItem, outcome: Outcome): Summary {
  if (outcome !== "failed" && outcome !== "completed") return { text: "" };
  const own = outcome === "completed" ? knownSummary(item) : null;
  if (own !== null) return { text: own };
  const texts = textsOf(item).filter(isProse);
  return {
    text: (outcome === "failed" ? texts.map(withoutCode) : texts).join("\n"),
    lang: isKnownCall(item) ? "en" : "", // the robot server's sentences are English
  };
}

/** A text for people, not data as JSON. */
function isProse(text: string): boolean {
  return text !== "" && !/^[[{]/.test(text);
}

/** Refusals begin with a code for programs, as in "occupied: The goal is inside a wall." */
function withoutCode(text: string): string {
  return text.replace(/^(?:Error: )?[a-z]+(?:_[a-z]+)*: (?=\S)/, "");
}

function knownSummary(item: ToolItem): string | null {
  const output = item.output;
  if (!isRecord(output)) return null;
  switch (item.tool) {
    case "navigate_to_place":
    case "navigate_to_pose":
      return driveSummary(output);
    case "rotate_in_place": {
      const took = asNumber(output["duration_s"]);
      return took === null ? null : i18next.t("summary.turned", { seconds: seconds(took) });
    }
    case "get_topological_map":
      return Array.isArray(output["nodes"])
        ? i18next.t("summary.places", { count: output["nodes"].length })
        : null;
    case "get_current_pose": {
      const place = asString(output["nearest_place"]);
      return place === null ? null : i18next.t("summary.near", { place });
    }
    case "get_robot_status": {
      const level = asNumber(output["battery"]);
      return level === null ? null : i18next.t("summary.battery", { level: percent(level) });
    }
    case "speak":
      if (output["audible"] === false) return i18next.t("summary.silent");
      return ""; // the sound player stands below
    case "take_photo":
      return ""; // the picture stands below
    default:
      return null;
  }
}

function driveSummary(output: Record<string, unknown>): string | null {
  const took = asNumber(output["duration_s"]);
  const distance = asNumber(output["distance"]);
  const length = asNumber(output["path_length"]);
  if (output["reached"] === true && took !== null && distance !== null) {
    return i18next.t("summary.arrived", { seconds: seconds(took), metres: metres(distance) });
  }
  return length !== null && output["reached"] !== true
    ? i18next.t("summary.pathOnly", { metres: metres(length) })
    : null;
}
