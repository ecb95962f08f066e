/** Taking the robot over from somebody: never without saying what ends by it, and what the robot does then. */
import { useState, type ReactNode } from "react";
import { useTranslation } from "react-i18next";
import { takeOverConsequences } from "../../state/people";
import { robotName, useMe, useStore } from "../../state/store";
import { Confirm } from "./confirm";
import { takeOver } from "../../acp/sessions/take-over";

/**
 * `ask` opens the confirmation, which is to be shown as `dialog`. `next` is the session that is to have the robot, if
 * one waits for it. A confirmation counts for the turn that it was opened for, and goes when that has ended.
 */
export function useTakeOver(next: string | null): { ask: () => void; dialog: ReactNode } {
  const { t } = useTranslation();
  const me = useMe();
  const robot = useStore(robotName);
  const turn = useStore((state) => state.telemetry?.turn ?? null);
  const driving = useStore((state) => Boolean(state.telemetry?.motion));
  const [meant, setMeant] = useState<string | null>(null);
  const open = turn !== null && turn.sessionId === meant;
  // Else it would open by itself when that session has the robot again.
  if (meant !== null && !open) setMeant(null);
  const told = turn && takeOverConsequences(turn, driving, me.name, next);
  const words = told && [
    t(`people.${told.ends}`, { name: told.holder }),
    t(`people.${told.then}`, { robot, name: told.next ?? "" }),
  ];
  const dialog = (
    <Confirm
      open={open}
      onOpenChange={(stays) => {
        if (!stays) setMeant(null);
      }}
      title={t("people.takeOverTitle", { robot })}
      text={words?.join(" ") ?? ""}
      no={t("people.leaveIt")}
      yes={t("people.takeOver")}
      testId="take-over-confirm"
      onYes={() => {
        if (meant !== null) void takeOver(next, meant);
      }}
    />
  );
  return { ask: () => setMeant(turn?.sessionId ?? null), dialog };
}
