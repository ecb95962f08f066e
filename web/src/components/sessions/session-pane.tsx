/** The list of sessions, newest first, with a search and a button for a new session. */
import { Plus, X } from "lucide-react";
import { Dialog } from "radix-ui";
import { useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import type { SessionInfo } from "@agentclientprotocol/sdk";
import { loadMoreResults } from "../../acp/sessions/search";
import { deleteSession, listMoreSessions, newSession } from "../../acp/sessions/sessions";
import { useNow } from "../../hooks/use-now";
import { useSessionSearch } from "../../hooks/use-session-search";
import { canPrompt } from "../../state/rights";
import { matchesSearch, searchWords } from "../../state/session-list";
import { toast, useMe, useStore } from "../../state/store";
import { Confirm } from "../controls/confirm";
import { PaneBoundary } from "../common/pane-boundary";
import { SentenceWithQuote } from "../common/sentence-with-quote";
import { SessionItem } from "./session-item";
import { SessionSearch } from "./session-search";

export function SessionPane({ onChosen }: { onChosen: () => void }) {
  const { t } = useTranslation();
  return (
    <nav className="pane sessions" aria-label={t("sessions.title")}>
      <PaneBoundary name={t("sessions.title")}>
        <SessionList onChosen={onChosen} />
      </PaneBoundary>
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
          <PaneBoundary name={t("sessions.title")}>
            <SessionList onChosen={() => props.onOpenChange(false)} />
          </PaneBoundary>
        </Dialog.Content>
      </Dialog.Portal>
    </Dialog.Root>
  );
}

function SessionList({ onChosen }: { onChosen: () => void }) {
  const { t } = useTranslation();
  const me = useMe();
  const [words, setWords] = useSessionSearch();
  const shown = useShownSessions(words);
  const online = useStore((state) => state.link.status === "online");
  const [toDelete, setToDelete] = useState<SessionInfo | null>(null);
  const newButton = useRef<HTMLButtonElement>(null);
  const list = useRef<HTMLDivElement>(null);
  const neighbour = (): HTMLElement | null => {
    const items = [...(list.current?.querySelectorAll<HTMLElement>("[data-session]") ?? [])];
    const at = items.findIndex(({ dataset }) => dataset["session"] === toDelete?.sessionId);
    return items[at + 1] ?? items[at - 1] ?? newButton.current;
  };
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
            ref={newButton}
            disabled={!online}
            onClick={begin}
          >
            <Plus aria-hidden /> {t("sessions.new")}
          </button>
        )}
        <SessionSearch words={words} onWords={setWords} />
      </div>
      <div className="sessions-scroll" ref={list} aria-busy={shown.searching}>
        <p className={shown.sessions.length === 0 ? "muted small sessions-none" : "sr-only"} role="status">
          {shown.text}
        </p>
        <Groups sessions={shown.sessions} onChosen={onChosen} onDelete={setToDelete} />
        {shown.more !== null && (
          <button
            type="button"
            className="button quiet wide"
            onClick={() => void shown.more?.().catch(() => undefined)}
          >
            {t("sessions.more")}
          </button>
        )}
      </div>
      <Confirm
        open={toDelete !== null}
        onOpenChange={(open) => {
          if (!open) setToDelete(null);
        }}
        title={t("sessions.deleteTitle")}
        text={
          <SentenceWithQuote
            sentence={t("sessions.deleteText", { title: toDelete?.title ?? t("sessions.untitled") })}
            quote={toDelete?.title ?? ""}
          />
        }
        no={t("sessions.keep")}
        yes={t("sessions.deleteYes")}
        danger
        after={neighbour}
        onYes={() => {
          if (toDelete === null) return;
          deleteSession(toDelete.sessionId).catch((error: unknown) => {
            toast("warning", error instanceof Error ? error.message : String(error), "en");
          });
        }}
      />
    </>
  );
}

interface ShownSessions {
  sessions: SessionInfo[];
  /** Loads the next page; null when there is none. */
  more: (() => Promise<void>) | null;
  searching: boolean;
  /** Shown where the list is empty, and announced by screen readers. */
  text: string;
}

/** The sessions that match the search: at first of those that are loaded, then of all, as the agent answers. */
function useShownSessions(search: string): ShownSessions {
  const { t } = useTranslation();
  const sessions = useStore((state) => state.sessions);
  const known = useStore((state) => state.sessionsKnown);
  const found = useStore((state) => state.found);
  const older = useStore((state) => state.moreSessions !== null);
  const words = searchWords(search).join(" ");
  if (words === "") {
    const text = known && sessions.length === 0 ? t("sessions.none") : "";
    return { sessions, more: older ? listMoreSessions : null, searching: !known, text };
  }
  const answered = found?.words === words;
  // An agent that does not know the search answers with the whole list.
  const matching = (answered ? found.sessions : sessions).filter((session) => matchesSearch(session, words));
  return {
    sessions: matching,
    more: answered && found.more !== null ? loadMoreResults : null,
    searching: !answered,
    text: !answered
      ? t("people.searching")
      : matching.length === 0
        ? t("people.foundNone", { words: search.trim() })
        : t("people.found", { count: matching.length }),
  };
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
