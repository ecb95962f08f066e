/** The first screen of a visit. */
import { useTranslation } from "react-i18next";
import { robotName, useStore } from "../state/store";
import { useRobotActivity, useActivityText } from "./answer/use-robot-activity";

export function Greeting() {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  const activity = useRobotActivity();
  const words = useActivityText(activity);
  return (
    <div className="kiosk-greeting">
      <h1>{t("kiosk.hello", { robot })}</h1>
      <p className="kiosk-lead" role="status" data-testid="kiosk-status" data-doing={activity.kind}>
        {activity.kind === "nothing" ? t("kiosk.whatNow") : words}
      </p>
    </div>
  );
}
