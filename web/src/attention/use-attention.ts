/** Calls a person to each new question once: a sound, and a notification while the page is not in front. */
import { useEffect, useRef } from "react";
import { useTranslation } from "react-i18next";
import { callWords } from "../i18n/known";
import { robotName, useStore } from "../state/store";
import { Calls } from "./fresh";
import { isInFront, notify } from "./notification";
import { useAttentionSettings } from "./settings";
import { chime, tuneAtFirstGesture } from "./sound";

export function useAttention(onClick: () => void): void {
  const { t } = useTranslation();
  const questions = useStore((state) => state.questions);
  const robot = useStore(robotName);
  const calls = useRef(new Calls());
  /** What takes each notification away, by the key of its question. */
  const shown = useRef(new Map<string, () => void>());

  useEffect(tuneAtFirstGesture, []);
  useEffect(() => {
    const open = new Set(questions.map(({ key }) => key));
    for (const [key, close] of shown.current) {
      if (open.has(key)) continue;
      close();
      shown.current.delete(key);
    }
    const fresh = calls.current.fresh(questions);
    if (fresh.length === 0) return;
    const settings = useAttentionSettings.getState();
    if (settings.sound) chime();
    if (settings.notify && !isInFront()) {
      for (const question of fresh) {
        const title = t("question.asks", { robot });
        shown.current.set(question.key, notify(question.key, title, callWords(question), onClick));
      }
    }
  }, [questions, robot, t, onClick]);
  useEffect(() => {
    const notifications = shown.current;
    return () => {
      for (const close of notifications.values()) close();
    };
  }, []);
}
