/** The dashboard: the arrangement of its parts on a wide window, a tablet and a phone. */
import { useCallback, useEffect, useState } from "react";
import { flushSync } from "react-dom";
import { useTranslation } from "react-i18next";
import { startDashboard } from "../../acp/screens/dashboard";
import { recordSamples } from "../../acp/screens/record-samples";
import { useAttention } from "../../attention/use-attention";
import { useLayout } from "../../hooks/use-layout";
import { callText } from "../../i18n/agent-terms";
import { robotName, useStore } from "../../state/store";
import { Boundary } from "../common/boundary";
import { Alerts } from "../alerts/alerts";
import { ActivityPanel } from "../activity/activity-panel";
import { Header } from "../header/header";
import { PANES_ID } from "../controls/panes";
import { PhoneTabs, type Tab } from "./phone-tabs";
import { ScenePane } from "../scene/scene-pane";
import { SessionDrawer, SessionPane } from "../sessions/session-pane";
import { CONVERSATION_ID } from "../conversation/composer-text";
import { TalkPane } from "../conversation/talk-pane";
import { Toasts } from "./toasts";
import { focusQuestion } from "../questions/question-card";
import "../../styles/dashboard.css";

export default function Dashboard() {
  const { t } = useTranslation();
  const layout = useLayout();
  const [tab, setTab] = useState<Tab>("talk");
  const [drawer, setDrawer] = useState(false);
  useDocumentTitle();

  useEffect(startDashboard, []);
  useEffect(recordSamples, []);

  const phone = layout === "phone";
  const showQuestion = useCallback((): void => {
    setTab("talk");
    setDrawer(false);
    // The pane has to be on the screen before anything in it can take the focus.
    requestAnimationFrame(focusQuestion);
  }, []);
  useAttention(showQuestion);

  return (
    <div className="app" data-layout={layout}>
      <a
        className="skip"
        href="#conversation"
        onClick={(event) => {
          event.preventDefault(); // the address names the session
          flushSync(() => setTab("talk"));
          document.getElementById(CONVERSATION_ID)?.focus();
        }}
      >
        {t("app.skip")}
      </a>
      <Header layout={layout} onMenu={() => setDrawer(true)} onQuestion={showQuestion} />
      <Alerts />
      <main className="panes" id={PANES_ID} tabIndex={-1} data-tab={tab}>
        {layout === "wide" && <SessionPane onChosen={() => undefined} />}
        {phone && tab === "sessions" && <SessionPane onChosen={() => setTab("talk")} />}
        <TalkPane hidden={phone && tab !== "talk"} />
        <div className="side">
          <ScenePane hidden={phone && tab !== "map"} lazy={phone} />
          <ActivityPanel layout={layout} hidden={phone && tab !== "log"} />
        </div>
      </main>
      {layout === "medium" && <SessionDrawer open={drawer} onOpenChange={setDrawer} />}
      {phone && <PhoneTabs tab={tab} onTab={setTab} />}
      <Boundary fallback={() => null}>
        <Toasts />
      </Boundary>
    </div>
  );
}

/** The title of the browser's tab: it shows a question also while another tab is in front. */
function useDocumentTitle(): void {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  const count = useStore((state) => state.questions.length);
  const question = useStore((state) => state.questions[0] ?? null);
  const what = question === null ? "" : callText(question);
  const stopped = useStore((state) => state.stop !== null && state.silentSince === null);
  useEffect(() => {
    if (count > 0) document.title = t("title.asks", { robot, count, what });
    else document.title = t(stopped ? "title.stopped" : "title.plain", { robot });
  }, [t, robot, count, what, stopped]);
}
