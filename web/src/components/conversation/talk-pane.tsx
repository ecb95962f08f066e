/** The conversation, and below it the pending question and the field to write in. */
import { useTranslation } from "react-i18next";
import { useStore } from "../../state/store";
import { PaneBoundary } from "../common/pane-boundary";
import { Composer } from "./composer";
import { ConversationLog } from "./conversation-log";
import { QuestionDock } from "../questions/question-card";

export function TalkPane({ hidden }: { hidden: boolean }) {
  const { t } = useTranslation();
  const sessionId = useStore((state) => state.currentId);
  return (
    <section className="pane talk" aria-label={t("talk.title")} hidden={hidden}>
      <PaneBoundary key={sessionId ?? "none"} name={t("talk.title")}>
        <ConversationLog />
      </PaneBoundary>
      <div className="talk-foot">
        <PaneBoundary name={t("tabs.question")}>
          <QuestionDock />
        </PaneBoundary>
        <PaneBoundary name={t("composer.name")}>
          <Composer />
        </PaneBoundary>
      </div>
    </section>
  );
}
