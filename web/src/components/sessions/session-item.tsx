/** One session of the list: its title, its owner, and whether a turn runs in it. */
import { CircleHelp, LoaderCircle, MessageSquare, Trash2 } from "lucide-react";
import { useTranslation } from "react-i18next";
import type { SessionInfo } from "@agentclientprotocol/sdk";
import { openSession } from "../../acp/sessions/sessions";
import { when } from "../../i18n/format";
import { canPrompt } from "../../state/rights";
import { mayDelete, isWorking } from "../../state/session-list";
import { useMe, useStore } from "../../state/store";
import { ownerOf } from "../../wire/meta";
import { visibleLine } from "../../wire/visible-text";

export function SessionItem(props: {
  session: SessionInfo;
  now: Date;
  onChosen: () => void;
  onDelete: (session: SessionInfo) => void;
}) {
  const { t } = useTranslation();
  const { session } = props;
  const me = useMe();
  const current = useStore((state) => state.currentId === session.sessionId);
  const canDelete = useStore((state) => state.canDelete && state.link.status === "online");
  const hasQuestion = useStore((state) =>
    state.questions.some(({ sessionId }) => sessionId === session.sessionId),
  );
  const works = useStore((state) =>
    isWorking(
      session,
      state.attached.has(session.sessionId) ? state.conversations[session.sessionId] : undefined,
      state.telemetry?.turn?.sessionId ?? null,
    ),
  );
  const title = visibleLine(session.title ?? t("sessions.untitled"));
  const owner = ownerOf(session._meta);
  const ownerText = visibleLine(owner ?? "");
  const Icon = hasQuestion ? CircleHelp : works ? LoaderCircle : MessageSquare;
  const choose = (): void => {
    openSession(session.sessionId).catch(() => undefined);
    props.onChosen();
  };
  return (
    <li className="session" data-current={current} data-works={works && !hasQuestion}>
      <button
        type="button"
        className="session-open"
        data-testid="session-item"
        data-session={session.sessionId}
        aria-current={current ? "true" : undefined}
        onClick={choose}
      >
        <Icon aria-hidden />
        <span className="session-title" title={title} lang={session.title == null ? undefined : ""}>
          {title}
        </span>
        <span className="session-sub">
          {/* A visitor sees only their own sessions. */}
          {owner !== null && me.role !== "visitor" && (
            <span className="session-owner" title={ownerText}>
              {owner === me.name ? t("people.you") : ownerText}
            </span>
          )}
          {hasQuestion || works ? (
            <span className="session-busy">{t(hasQuestion ? "sessions.asks" : "sessions.working")}</span>
          ) : (
            session.updatedAt && <span>{when(new Date(session.updatedAt), props.now)}</span>
          )}
        </span>
      </button>
      {canDelete && canPrompt(me.role) && mayDelete(session, me) && (
        <button
          type="button"
          className="icon-button session-delete"
          aria-label={t("sessions.delete", { title })}
          onClick={() => props.onDelete(session)}
        >
          <Trash2 aria-hidden />
        </button>
      )}
    </li>
  );
}
