/** A step that waits because somebody else controls the robot: who that is, and a button to take over for supervisors. */
import { Hourglass } from "lucide-react";
import { useTranslation } from "react-i18next";
import { canTakeOver } from "../../state/rights";
import { robotName, useMe, useStore } from "../../state/store";
import { useTakeOver } from "../controls/use-take-over";

export function WaitingForRobot() {
  const { t } = useTranslation();
  const me = useMe();
  const robot = useStore(robotName);
  const here = useStore((state) => state.currentId);
  const turn = useStore((state) => state.telemetry?.turn ?? null);
  const { ask, dialog } = useTakeOver(here);
  const held = turn !== null && turn.sessionId !== here;
  return (
    <div className="awaited" data-testid="robot-awaited">
      <Hourglass aria-hidden />
      <p>
        {!held
          ? t("people.awaited", { robot })
          : turn.by === me.name
            ? t("people.awaitedOwn", { robot })
            : t("people.awaitedFrom", { robot, name: turn.by })}
      </p>
      {held && canTakeOver(me.role) && (
        <button type="button" className="button" data-testid="take-over-here" onClick={ask}>
          {t("people.takeOver")}
        </button>
      )}
      {dialog}
    </div>
  );
}
