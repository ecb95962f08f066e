/** The two views of the activity panel: the turn with the plots, and the log of the session. */
import { Tabs } from "radix-ui";
import { useTranslation } from "react-i18next";
import { useStore } from "../../state/store";
import { LogView } from "./log-view";
import { Plots } from "./plots";
import { TurnView } from "./turn-view";

export default function ActivityBody() {
  const { t, i18n } = useTranslation();
  const sessionId = useStore((state) => state.currentId);
  return (
    <Tabs.Root defaultValue="turn" className="activity-tabs">
      <Tabs.List className="activity-list" aria-label={t("activity.views")}>
        <Tabs.Trigger value="turn" className="activity-tab">
          {t("activity.turn")}
        </Tabs.Trigger>
        <Tabs.Trigger value="log" className="activity-tab" data-testid="log-tab">
          {t("activity.log")}
        </Tabs.Trigger>
      </Tabs.List>
      <Tabs.Content value="turn" className="activity-turn">
        <TurnView />
        <Plots />
      </Tabs.Content>
      <Tabs.Content value="log" className="activity-log">
        {sessionId === null ? (
          <p className="muted small log-none">{t("log.noSession")}</p>
        ) : (
          // Rows keep the language in which they were made, so another language needs a new log.
          <LogView key={`${sessionId} ${i18n.language}`} sessionId={sessionId} />
        )}
      </Tabs.Content>
    </Tabs.Root>
  );
}
