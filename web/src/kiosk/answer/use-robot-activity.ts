/** What the robot is doing for the visitor, and the texts for it. */
import { useTranslation } from "react-i18next";
import { useShallow } from "zustand/react/shallow";
import { metres, wholeSeconds } from "../../i18n/format";
import { EMPTY } from "../../state/conversation/conversation";
import { robotName, useStore } from "../../state/store";
import { robotActivity, type RobotActivity } from "./robot-activity";
import { isWord } from "../ask/suggestions";

/** Below this distance the text says "nearly there" instead of a number. */
const NEAR_M = 1;

export function useRobotActivity(): RobotActivity {
  return useStore(
    useShallow(({ link, telemetry, silentSince, conversations, currentId, opening }) => {
      if (opening) return { kind: "thinking" } as const;
      const conversation = currentId === null ? EMPTY : (conversations[currentId] ?? EMPTY);
      return robotActivity(link, telemetry, silentSince, conversation, currentId);
    }),
  );
}

export function useActivityText(activity: RobotActivity): string {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  switch (activity.kind) {
    case "nothing":
      return "";
    case "driving":
      if (activity.place === null) return t("doing.driving");
      return t(isWord(activity.place) ? "doing.drivingToThe" : "doing.drivingTo", { place: activity.place });
    case "speaking":
      return t("doing.speaking", { text: activity.text });
    case "tool":
      return activity.what;
    default:
      return t(`doing.${activity.kind}`, { robot });
  }
}

/** The text below the large line: the distance that is left, or what waits to be allowed. */
export function useActivityDetail(activity: RobotActivity): string {
  const { t } = useTranslation();
  if (activity.kind === "permission") {
    return activity.says === null ? activity.what : t("doing.toSay", { text: activity.says });
  }
  if (activity.kind !== "driving" || activity.metres === null || activity.seconds === null) return "";
  if (activity.metres < NEAR_M) return t("doing.near");
  return t("doing.left", { distance: metres(activity.metres), seconds: wholeSeconds(activity.seconds) });
}
