/** What the robot is robotActivity for the visitor, and the words for it. */
import { useTranslation } from "react-i18next";
import { useShallow } from "zustand/react/shallow";
import { metres, wholeSeconds } from "../../i18n/format";
import { EMPTY } from "../../state/conversation/conversation";
import { robotName, useStore } from "../../state/store";
import { robotActivity, type RobotActivity } from "./robot-activity";
import { isWord } from "../ask/suggestions";

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

export function useActivityText(what: RobotActivity): string {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  switch (what.kind) {
    case "nothing":
      return "";
    case "driving":
      if (what.place === null) return t("doing.driving");
      return t(isWord(what.place) ? "doing.drivingToThe" : "doing.drivingTo", { place: what.place });
    case "speaking":
      return t("doing.speaking", { text: what.text });
    case "tool":
      return what.what;
    default:
      return t(`doing.${what.kind}`, { robot });
  }
}

/** What there is to say beside the one large line: the way that is left, or what waits to be allowed. */
export function useActivityDetail(what: RobotActivity): string {
  const { t } = useTranslation();
  if (what.kind === "permission") {
    return what.says === null ? what.what : t("doing.toSay", { text: what.says });
  }
  if (what.kind !== "driving" || what.metres === null || what.seconds === null) return "";
  if (what.metres < NEAR_M) return t("doing.near");
  return t("doing.left", { distance: metres(what.metres), seconds: wholeSeconds(what.seconds) });
}
