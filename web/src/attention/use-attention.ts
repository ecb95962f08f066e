/** Calls a person to each new question: one sound, and a notification while it is open and the page is not in front. */
import { useEffect, useRef } from "react";
import { useTranslation } from "react-i18next";
import { moveQuestionFirst } from "../acp/sessions/questions";
import { callText } from "../i18n/agent-terms";
import { robotName, useStore } from "../state/store";
import { AnnouncedQuestions, questionName } from "./announced-questions";
import { isInFront, notify } from "./notification";
import { useAttentionSettings } from "./settings";
import { chime, prepareAudioAtGesture } from "./sound";

/** `onClick`: somebody clicked a notification, and its question is the first one now. */
export function useAttention(onClick: () => void): void {
  const { t } = useTranslation();
  const questions = useStore((state) => state.questions);
  const robot = useStore(robotName);
  const announced = useRef(new AnnouncedQuestions());
  /** Closes each open notification, by the name of its question. */
  const notifications = useRef(new Map<string, () => void>());

  useEffect(prepareAudioAtGesture, []);
  useEffect(() => {
    const open = new Set(questions.map(questionName));
    for (const [name, close] of notifications.current) {
      if (open.has(name)) continue;
      close();
      notifications.current.delete(name);
    }
    const settings = useAttentionSettings.getState();
    if (announced.current.takeNew(questions).length > 0 && settings.sound) chime();
    if (!settings.notify || isInFront()) return;
    for (const question of questions) {
      // Not only for new questions: a lost connection closed the notifications of those that come again.
      const name = questionName(question);
      if (notifications.current.has(name)) continue;
      const title = t("question.asks", { robot });
      const showQuestion = (): void => {
        moveQuestionFirst(question);
        onClick();
      };
      notifications.current.set(name, notify(name, title, callText(question), showQuestion));
    }
  }, [questions, robot, t, onClick]);
  useEffect(() => {
    const open = notifications.current;
    return () => {
      for (const close of open.values()) close();
    };
  }, []);
}
