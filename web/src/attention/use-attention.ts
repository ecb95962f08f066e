/** Calls a person to each new question: one sound, and a notification while it is open and the page is not in front. */
import { useEffect, useRef } from "react";
import { useTranslation } from "react-i18next";
import { putFirst } from "../acp/sessions/questions";
import { callWords } from "../i18n/agent-terms";
import { robotName, useStore } from "../state/store";
import { Calls, nameOf } from "./announced-questions";
import { isInFront, notify } from "./notification";
import { useAttentionSettings } from "./settings";
import { chime, tuneAtFirstGesture } from "./sound";

export function useAttention(onClick: () => void): void {
  const { t } = useTranslation();
  const questions = useStore((state) => state.questions);
  const robot = useStore(robotName);
  const calls = useRef(new Calls());
  /** What takes each notification away, by the name of its question. */
  const shown = useRef(new Map<string, () => void>());

  useEffect(tuneAtFirstGesture, []);
  useEffect(() => {
    const open = new Set(questions.map(nameOf));
    for (const [name, close] of shown.current) {
      if (open.has(name)) continue;
      close();
      shown.current.delete(name);
    }
    const settings = useAttentionSettings.getState();
    if (calls.current.fresh(questions).length > 0 && settings.sound) chime();
    if (!settings.notify || isInFront()) return;
    for (const question of questions) {
      // One that comes again after a cut has none any more: whoever is away would never know of it.
      const name = nameOf(question);
      if (shown.current.has(name)) continue;
      const title = t("question.asks", { robot });
      const come = (): void => {
        putFirst(question);
        onClick();
      };
      shown.current.set(name, notify(name, title, callWords(question), come));
    }
  }, [questions, robot, t, onClick]);
  useEffect(() => {
    const notifications = shown.current;
    return () => {
      for (const close of notifications.values()) close();
    };
  }, []);
}
