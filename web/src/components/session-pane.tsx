/** The sessions to go back to: newest first, searchable, and a way to begin a new one. */
import { MessageSquare, Plus, Search, Trash2, X } from "lucide-react";
import { Dialog } from "radix-ui";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import type { SessionInfo } from "@agentclientprotocol/sdk";
import { deleteSession, listMoreSessions, newSession, openSession } from "../acp/sessions";
import { useNow } from "../hooks/use-now";
import { when } from "../i18n/format";
import { canPrompt } from "../state/rights";
import { toast, useMe, useStore } from "../state/store";
import { Confirm } from "./confirm";

export function SessionPane({ onChosen }: { onChosen: () => void }) {
  const { t } = useTranslation();
  return (
    <nav className="pane sessions" aria-label={t("sessions.title")}>
      <SessionList onChosen={onChosen} />
    </nav>
  );
}

export function SessionDrawer(props: { open: boolean; onOpenChange: (open: boolean) => void }) {
  const { t } = useTranslation();
  return (
    <Dialog.Root open={props.open} onOpenChange={props.onOpenChange}>
      <Dialog.Portal>
        <Dialog.Overlay className="overlay below-bar" />
        <Dialog.Content className="drawer sessions" aria-describedby={undefined}>
          <div className="drawer-head">
            <Dialog.Title>{t("sessions.title")}</Dialog.Title>
            <Dialog.Close className="icon-button" aria-label={t("sessions.close")}>
              <X aria-hidden />
            </Dialog.Close>
          </div>
          <SessionList onChosen={() => props.onOpenChange(false)} />
        </Dialog.Content>
      </Dialog.Portal>
    </Dialog.Root>
  );
}

function SessionList({ onChosen }: { onChosen: () => void }) {
  const { t } = useTranslation();
  const me = useMe();
  const [words, setWords] = useState("");
  const sessions = useStore((state) => state.sessions);
  const known = useStore((state) => state.sessionsKnown);
  const more = useStore((state) => state.moreSessions !== null);
  const online = useStore((state) => state.link.status === "online");
  const [doomed, setDoomed] = useState<SessionInfo | null>(null);
  const found = sessions.filter((session) =>
    (session.title ?? "").toLocaleLowerCase().includes(words.trim().toLocaleLowerCase()),
  );
  const begin = (): void => {
    newSession().then(onChosen, () => undefined);
  };
  return (
    <>
      <div className="sessions-top">
        {canPrompt(me.role) && (
          <button
            type="button"
            className="button wide"
            data-testid="new-session"
            disabled={!online}
            onClick={begin}
          >
            <Plus aria-hidden /> {t("sessions.new")}
          </button>
        )}
        <label className="search">
          <Search aria-hidden />
          <span className="sr-only">{t("sessions.search")}</span>
          <input
            type="search"
            value={words}
            placeholder={t("sessions.search")}
            onChange={(event) => setWords(event.target.value)}
          />
        </label>
      </div>
      <div className="sessions-scroll">
        {found.length === 0 ? (
          <p className="muted small sessions-none">
            {known && (sessions.length === 0 ? t("sessions.none") : t("sessions.noneFound"))}
          </p>
        ) : (
          <Groups sessions={found} onChosen={onChosen} onDelete={setDoomed} />
        )}
        {more && words === "" && (
          <button
            type="button"
            className="button quiet wide"
            onClick={() => void listMoreSessions().catch(() => undefined)}
          >
            {t("sessions.more")}
          </button>
        )}
      </div>
      <Confirm
        open={doomed !== null}
        onOpenChange={(open) => {
          if (!open) setDoomed(null);
        }}
        title={t("sessions.deleteTitle")}
        text={t("sessions.deleteText", { title: doomed?.title ?? t("sessions.untitled") })}
        no={t("sessions.keep")}
        yes={t("sessions.deleteYes")}
        danger
        onYes={() => {
          if (doomed === null) return;
          deleteSession(doomed.sessionId).catch((error: unknown) => {
            toast("danger", error instanceof Error ? error.message : String(error));
          });
        }}
      />
    </>
  );
}

type Age = "today" | "yesterday" | "earlier";

function ageOf(session: SessionInfo, now: Date): Age {
  const at = new Date(session.updatedAt ?? 0);
  if (at.toDateString() === now.toDateString()) return "today";
  const before = new Date(now);
  before.setDate(now.getDate() - 1);
  return at.toDateString() === before.toDateString() ? "yesterday" : "earlier";
}

function Groups(props: {
  sessions: SessionInfo[];
  onChosen: () => void;
  onDelete: (session: SessionInfo) => void;
}) {
  const { t } = useTranslation();
  const now = new Date(useNow(60_000));
  return (["today", "yesterday", "earlier"] as const).map((age) => {
    const members = props.sessions.filter((session) => ageOf(session, now) === age);
    if (members.length === 0) return null;
    return (
      <section key={age} aria-label={t(`sessions.${age}`)}>
        <h2 className="sessions-age">{t(`sessions.${age}`)}</h2>
        <ul className="sessions-list">
          {members.map((session) => (
            <SessionItem key={session.sessionId} session={session} now={now} {...props} />
          ))}
        </ul>
      </section>
    );
  });
}

function SessionItem(props: {
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
  const asks = useStore((state) => state.questions.some(({ sessionId }) => sessionId === session.sessionId));
  const working = useStore(
    (state) =>
      state.telemetry?.turn?.sessionId === session.sessionId ||
      Boolean(state.conversations[session.sessionId]?.turn),
  );
  const title = session.title ?? t("sessions.untitled");
  const choose = (): void => {
    openSession(session.sessionId).catch(() => undefined);
    props.onChosen();
  };
  return (
    <li className="session" data-current={current}>
      <button
        type="button"
        className="session-open"
        data-testid="session-item"
        aria-current={current ? "true" : undefined}
        onClick={choose}
      >
        <MessageSquare aria-hidden />
        <span className="session-title" title={title}>
          {title}
        </span>
        <span className="session-sub">
          {asks || working ? (
            <span className="session-busy">{t(asks ? "sessions.asks" : "sessions.working")}</span>
          ) : (
            session.updatedAt && when(new Date(session.updatedAt), props.now)
          )}
        </span>
      </button>
      {canDelete && canPrompt(me.role) && (
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
