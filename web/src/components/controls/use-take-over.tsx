/** Takes control of the robot from somebody, after a confirmation that says what ends and what the robot does then. */
import { useState, type ReactNode } from "react";
import { useTranslation } from "react-i18next";
import { takeOverConsequences } from "../../state/people";
import { robotName, useMe, useStore } from "../../state/store";
import { Confirm } from "./confirm";
import { takeOver } from "../../acp/sessions/take-over";

/**
 * `ask` opens the confirmation; the caller renders `dialog`. `next` is the session that controls the robot afterwards, if
 * one waits for it. A confirmation is about the turn for which it was opened, and closes when that turn ends.
 */
export function useTakeOver(next: string | null): { ask: () => void; dialog: ReactNode } {
  const { t } = useTranslation();
  const me = useMe();
  const robot = useStore(robotName);
  const turn = useStore((state) => state.telemetry?.turn ?? null);
  const driving = useStore((state) => Boolean(state.telemetry?.motion));
  /** The session whose turn the open confirmation would end. */
  const [targetId, setTargetId] = useState<string | null>(null);
  const open = turn !== null && turn.sessionId === targetId;
  // Otherwise it would open by itself when that session controls the robot again.
  if (targetId !== null && !open) setTargetId(null);
  const outcome = turn && takeOverConsequences(turn, driving, me.name, next);
  const words = outcome && [
    t(`people.${outcome.ends}`, { name: outcome.holder }),
    t(`people.${outcome.then}`, { robot, name: outcome.next ?? "" }),
  ];
  const dialog = (
    <Confirm
      open={open}
      onOpenChange={(stays) => {
        if (!stays) setTargetId(null);
      }}
      title={t("people.takeOverTitle", { robot })}
      text={words?.join(" ") ?? ""}
      no={t("people.leaveIt")}
      yes={t("people.takeOver")}
      testId="take-over-confirm"
      onYes={() => {
        if (targetId !== null) void takeOver(next, targetId);
      }}
    />
  );
  return { ask: () => setTargetId(turn?.sessionId ?? null), dialog };
}
