/** The conversation on the screen, oldest item first. */
import { ArrowDown } from "lucide-react";
import { memo, useEffect, useState } from "react";
import { useTranslation } from "react-i18next";
import { useConversation } from "../../hooks/use-conversation";
import { useStickToEnd } from "../../hooks/use-stick-to-end";
import type { Item } from "../../state/conversation/conversation";
import { canPrompt } from "../../state/rights";
import { robotName, useMe, useStore } from "../../state/store";
import { openSession } from "../../acp/sessions/sessions";
import { SentenceWithQuote } from "../common/sentence-with-quote";
import { Boundary } from "../common/boundary";
import { AgentMessage, Note, Thought, UserMessage } from "./messages";
import { PlanCard } from "./plan-card";
import { CONVERSATION_ID, setComposerText } from "./composer-text";
import { ToolCard } from "./tool-card";

export function ConversationLog() {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  const { items, dropped, turn, made } = useConversation();
  const opening = useStore((state) => state.opening && state.link.status === "online");
  const notOpened = useStore((state) => state.notOpened);
  const { box, content, atEnd, toEnd } = useStickToEnd();
  const [seen, setSeen] = useState(made);
  const last = items.at(-1);
  const waitsForRobot = last?.kind === "tool" && last.waiting === "robot";
  const hasTelemetry = useStore((state) => state.silentSince === null);
  const asked = useStore((state) => state.questions.some(({ sessionId }) => sessionId === state.currentId));

  // Whoever sends a message wants to see it.
  const ownMessage = last?.kind === "user" ? last.key : null;
  useEffect(() => {
    if (ownMessage !== null) toEnd();
  }, [ownMessage, toEnd]);
  if (atEnd && seen !== made) setSeen(made);

  return (
    <div className="log-frame">
      <div
        className="log"
        id={CONVERSATION_ID}
        data-testid="conversation"
        role="log"
        aria-label={t("talk.title")}
        aria-live="polite"
        aria-relevant="additions"
        aria-busy={opening}
        // The keyboard must be able to scroll it, too.
        // eslint-disable-next-line jsx-a11y/no-noninteractive-tabindex
        tabIndex={0}
        ref={box}
      >
        <div className="log-content" ref={content}>
          {notOpened !== null ? <NotOpened /> : null}
          {items.length === 0 && notOpened === null ? opening ? <Opening /> : <Empty /> : null}
          {dropped > 0 && <p className="muted earlier">{t("talk.earlier", { count: dropped })}</p>}
          {items.map((item) => (
            <Boundary
              key={item.key}
              resetKey={item}
              fallback={() => <p className="note">{t("pane.entry")}</p>}
            >
              <ItemView item={item} />
            </Boundary>
          ))}
          {turn !== null && last?.kind !== "agent" && !asked && !waitsForRobot && hasTelemetry && (
            <p className="working" aria-hidden="true">
              <span className="working-dots" />
              {t("talk.working", { robot })}
            </p>
          )}
        </div>
      </div>
      {!atEnd && (
        <button type="button" className="to-end" onClick={toEnd}>
          <ArrowDown aria-hidden /> {t(made > seen ? "talk.newMessages" : "talk.toEnd")}
        </button>
      )}
    </div>
  );
}

const ItemView = memo(function ItemView({ item }: { item: Item }) {
  switch (item.kind) {
    case "user":
      return <UserMessage item={item} />;
    case "thought":
      return <Thought item={item} />;
    case "agent":
      return <AgentMessage item={item} />;
    case "plan":
      return <PlanCard item={item} />;
    case "tool":
      return <ToolCard item={item} />;
    case "note":
      return <Note item={item} />;
  }
});

function Opening() {
  const { t } = useTranslation();
  return (
    <div className="opening" role="status">
      <span className="sr-only">{t("talk.loading")}</span>
      {[56, 82, 70, 38].map((width) => (
        <span key={width} className="bone" style={{ width: `${width}%` }} />
      ))}
    </div>
  );
}

function NotOpened() {
  const { t } = useTranslation();
  const reason = useStore((state) => state.notOpened) ?? "";
  const sessionId = useStore((state) => state.currentId);
  return (
    <div className="note note-failed" role="alert" data-testid="not-opened">
      <p>
        <SentenceWithQuote sentence={t("talk.notOpened", { reason })} quote={reason} lang="en" />
      </p>
      <button
        type="button"
        className="button"
        onClick={() => {
          if (sessionId !== null) openSession(sessionId).catch(() => undefined);
        }}
      >
        {t("pane.again")}
      </button>
    </div>
  );
}

const SUGGESTIONS = ["abilities", "where", "photo", "battery"] as const;

function Empty() {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  const me = useMe();
  const chosen = useStore((state) => state.currentId !== null);
  if (!canPrompt(me.role)) {
    return (
      <div className="empty">
        <h2>{t("talk.emptyViewer", { robot })}</h2>
        {!chosen && <p className="muted">{t("talk.emptyNoSession")}</p>}
      </div>
    );
  }
  return (
    <div className="empty">
      <h2>{t("talk.emptyTitle", { robot })}</h2>
      <p className="muted">{t("talk.emptyText")}</p>
      <ul className="suggestions" aria-label={t("suggestions.label")}>
        {SUGGESTIONS.map((key) => (
          <li key={key}>
            <button type="button" className="button" onClick={() => setComposerText(t(`suggestions.${key}`))}>
              {t(`suggestions.${key}`)}
            </button>
          </li>
        ))}
      </ul>
    </div>
  );
}
