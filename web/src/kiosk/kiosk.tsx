/** The visitor's screen: a greeting with suggestions, then what was asked, what the robot does, and its answer. */
import { useCallback, useEffect, useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import { stopRobot } from "../acp/connection/stop";
import { sendRequest, endVisit, startKiosk } from "../acp/screens/kiosk-visit";
import { Boundary } from "../components/common/boundary";
import { PaneBoundary } from "../components/common/pane-boundary";
import { StopButton } from "../components/common/stop-button";
import { canPrompt } from "../state/rights";
import { conversationOf, robotName, setState, useMe, useStore } from "../state/store";
import { AskBar } from "./ask/ask-bar";
import { Answer } from "./answer/answer";
import { Greeting } from "./greeting";
import { KioskMap } from "./kiosk-map";
import "./styles.css";
import { Notices } from "./notices";
import { kioskSettings } from "./settings";
import { StillThere } from "./idle/still-there";
import { Suggestions } from "./ask/suggestion-list";
import { TopLine } from "./top-line";
import { useIdleTimer } from "./idle/use-idle-timer";
import { isOutdated } from "../components/common/build-version";
import { initialLanguage, setLanguage } from "../i18n/page-language";

const SETTINGS = kioskSettings(window.location.search);

export default function Kiosk() {
  const { t, i18n } = useTranslation();
  const me = useMe();
  const robot = useStore(robotName);
  const visiting = useStore((state) => state.currentId !== null || state.opening);
  const opening = useStore((state) => state.opening);
  const online = useStore((state) => state.link.status === "online");
  const [text, setText] = useState("");
  const [failed, setFailed] = useState(false);
  /** Counts visitors: what belonged to the one before comes too late for the next. */
  const visitor = useRef(0);
  const [visitorKey, setVisitorKey] = useState(0);
  const turn = useStore((state) => conversationOf(state).turn);
  const running = turn !== null || opening;

  useEffect(startKiosk, []);
  useEffect(() => {
    document.title = t("kiosk.title", { robot });
  }, [t, robot]);

  const startOver = useCallback(() => {
    endVisit();
    visitor.current++;
    setVisitorKey(visitor.current);
    setText("");
    setFailed(false);
    setState({ stopError: null });
    setLanguage(initialLanguage());
  }, []);
  const startOverAlone = useCallback(() => {
    startOver();
    void isOutdated().then((outdated) => {
      if (outdated) window.location.reload();
    });
  }, [startOver]);
  // A turn pauses the time, but not without a connection: then nobody knows whether it runs, and the visitor's words must not stay.
  const { endsAt, stay } = useIdleTimer(SETTINGS.idleMs, running && online, startOverAlone);
  const hasVisitor = visiting || text !== "" || i18n.language !== initialLanguage();

  const request = (words: string): void => {
    setText("");
    setFailed(false);
    // A refused prompt is part of the conversation; this is about a session that could not be begun.
    const asker = visitor.current;
    const giveBack = (): void => {
      if (asker !== visitor.current) return;
      setText((since) => (since === "" ? words : since));
      setFailed(true);
    };
    sendRequest(words, me.name).then((arrived) => {
      if (!arrived) giveBack();
    }, giveBack);
  };

  return (
    <div className="kiosk" data-visiting={visiting}>
      <TopLine onStartOver={visiting ? startOver : null} />
      <main className="kiosk-main">
        <section className="kiosk-talk">
          <PaneBoundary key={String(visiting)} name={t("kiosk.talk")}>
            {visiting ? <Answer /> : <Greeting />}
          </PaneBoundary>
          {failed && (
            <p className="kiosk-note" role="alert">
              {t("kiosk.notBegun")}
            </p>
          )}
        </section>
        {canPrompt(me.role) ? (
          <section className="kiosk-ask" aria-label={t("kiosk.suggestions")} data-running={running}>
            {!running && (
              <Boundary fallback={() => null}>
                <Suggestions compact={visiting} onRequest={request} />
              </Boundary>
            )}
            <AskBar
              key={visitorKey}
              text={text}
              onText={setText}
              running={running}
              voice={SETTINGS.voice}
              onSend={() => request(text.trim())}
            />
          </section>
        ) : (
          <p className="kiosk-note">{t("kiosk.onlyWatch")}</p>
        )}
        {SETTINGS.map && (
          <Boundary fallback={() => null}>
            <KioskMap />
          </Boundary>
        )}
      </main>
      <footer className="kiosk-foot">
        <PaneBoundary name={t("toast.region")}>
          <Notices onStopAgain={() => void stopRobot()} />
        </PaneBoundary>
        <StopButton />
      </footer>
      {endsAt !== null && hasVisitor && <StillThere endsAt={endsAt} onStay={stay} />}
    </div>
  );
}
