/**
 * All events of the session: filtered by kind and by words, opened one by one, exported as a file. Only one page of rows
 * is on the screen at a time, so that a long session stays quick.
 */
import { ChevronFirst, ChevronLast, ChevronLeft, ChevronRight, Download, Search } from "lucide-react";
import { useEffect, useMemo, useState, useSyncExternalStore } from "react";
import { useTranslation } from "react-i18next";
import { EventLog, type Snapshot } from "../../acp/events/event-log";
import { subscribeToEvents } from "../../acp/events/event-feed";
import { exportEvents, readEvents } from "../../acp/events/event-pages";
import { useStickToEnd } from "../../hooks/use-stick-to-end";
import {
  FILTERS,
  fileName,
  LONGEST_PAGE,
  filterRows,
  PAGE,
  pageOf,
  startOf,
  type Filter,
  type Kind,
  type Row,
} from "../../state/log-rows";
import { getState, robotName, toast, useStore } from "../../state/store";
import { LogRow } from "./log-row";

const ALL: ReadonlySet<Filter> = new Set(FILTERS);

export function LogView({ sessionId }: { sessionId: string }) {
  const { t } = useTranslation();
  const { rows, status } = useEventLog(sessionId);
  const [kinds, setKinds] = useState(ALL);
  const [words, setWords] = useState("");
  /** The number of the first event of the page on the screen; null for the newest page. */
  const [from, setFrom] = useState<number | null>(null);
  /** Counts page turns. As the page's key it makes each turn begin at the start, also the turn to the same page. */
  const [turns, setTurns] = useState(0);
  /** The result of the last search, for screen readers; events that come later are not announced. */
  const [announcement, setAnnouncement] = useState("");
  const nameOf = useMemo(() => (kind: Kind) => t(`logKind.${kind}`), [t]);
  const found = useMemo(() => filterRows(rows, kinds, words, nameOf), [rows, kinds, words, nameOf]);

  const turnTo = (to: number | null): void => {
    setFrom(to);
    setTurns((count) => count + 1);
  };
  const applyFilter = (nextKinds: ReadonlySet<Filter>, nextWords: string): void => {
    setKinds(nextKinds);
    setWords(nextWords);
    turnTo(null);
    const count = filterRows(rows, nextKinds, nextWords, nameOf).length;
    setAnnouncement(t("log.count", { found: count, all: rows.length }));
  };
  const toggle = (filter: Filter): void => {
    const next = new Set(kinds);
    if (!next.delete(filter)) next.add(filter);
    applyFilter(next, words);
  };

  return (
    <>
      <div className="log-tools">
        <label className="search">
          <Search aria-hidden />
          <span className="sr-only">{t("log.search")}</span>
          <input
            type="search"
            value={words}
            placeholder={t("log.search")}
            onChange={(event) => applyFilter(kinds, event.target.value)}
          />
        </label>
        <Export sessionId={sessionId} empty={rows.length === 0} />
        <div className="log-filters" role="group" aria-label={t("log.filter")}>
          {FILTERS.map((filter) => (
            <button
              key={filter}
              type="button"
              className="chip"
              aria-pressed={kinds.has(filter)}
              data-testid={`log-filter-${filter}`}
              onClick={() => toggle(filter)}
            >
              {t(`logFilter.${filter}`)}
            </button>
          ))}
        </div>
      </div>
      {status === "unavailable" ? (
        <p className="muted small log-none">{t("log.unavailable")}</p>
      ) : found.length === 0 ? (
        <p className="muted small log-none" role="status">
          {t(status === "reading" ? "log.reading" : rows.length === 0 ? "log.empty" : "log.noneFound")}
        </p>
      ) : (
        <LogPage key={turns} rows={found} from={from} sessionId={sessionId} nameOf={nameOf} />
      )}
      <div className="log-foot">
        <span className="muted small" data-testid="log-count">
          {t("log.count", { found: found.length, all: rows.length })}
          {(rows[0]?.seq ?? 1) > 1 && ` ${t("log.older")}`}
          {status === "behind" && ` ${t("log.behind")}`}
        </span>
        <span className="sr-only" role="status" data-testid="log-said">
          {status === "behind" ? t("log.behind") : announcement}
        </span>
        <Pages rows={found} from={from} onPage={turnTo} />
      </div>
    </>
  );
}

function useEventLog(sessionId: string): Snapshot {
  const [log] = useState(() => new EventLog((after) => readEvents(sessionId, after)));
  const online = useStore((state) => state.link.status === "online" && state.attached.has(sessionId));
  useEffect(
    () => subscribeToEvents((where, event) => where === sessionId && log.receive(event)),
    [log, sessionId],
  );
  useEffect(() => {
    if (online) void log.catchUp();
  }, [log, online]);
  return useSyncExternalStore(log.subscribe, log.getSnapshot);
}

/**
 * A page of rows. The newest page follows the events that come while its end is visible; while somebody reads further up,
 * its rows stay and new ones are added below them.
 */
function LogPage(props: {
  rows: readonly Row[];
  from: number | null;
  sessionId: string;
  nameOf: (kind: Kind) => string;
}) {
  const { t } = useTranslation();
  const newest = props.from === null;
  const { box, content, atEnd } = useStickToEnd(newest);
  /** The first row of the newest page while somebody reads further up in it; null while the page follows. */
  const [heldAt, setHeldAt] = useState<number | null>(null);
  const page = pageOf(
    props.rows,
    newest ? heldAt : props.from,
    newest && heldAt !== null ? LONGEST_PAGE : PAGE,
  );
  const first = page[0]?.seq ?? null;
  if (newest && atEnd !== (heldAt === null)) setHeldAt(atEnd ? null : first);
  return (
    <div
      className="log-rows"
      data-testid="log-rows"
      ref={box}
      role="region"
      aria-label={t("log.title")}
      // The keyboard must be able to scroll it, too.
      // eslint-disable-next-line jsx-a11y/no-noninteractive-tabindex
      tabIndex={0}
    >
      <div ref={content}>
        <ol>
          {page.map((row) => (
            <LogRow key={row.seq} row={row} name={props.nameOf(row.kind)} sessionId={props.sessionId} />
          ))}
        </ol>
      </div>
    </div>
  );
}

function Pages({
  rows,
  from,
  onPage,
}: {
  rows: readonly Row[];
  from: number | null;
  onPage: (from: number | null) => void;
}) {
  const { t } = useTranslation();
  const pages = Math.ceil(rows.length / PAGE);
  if (pages <= 1) return null;
  const last = rows.length - PAGE;
  const start = startOf(rows, from);
  const go = (to: number): void => onPage(to >= last ? null : (rows[Math.max(0, to)]?.seq ?? null));
  const buttons = [
    { name: "oldest", Icon: ChevronFirst, to: 0, off: start === 0 },
    { name: "earlier", Icon: ChevronLeft, to: start - PAGE, off: start === 0 },
    { name: "later", Icon: ChevronRight, to: start + PAGE, off: from === null },
    { name: "newest", Icon: ChevronLast, to: last, off: false },
  ] as const;
  return (
    <nav className="log-pages" aria-label={t("log.pages")}>
      <span className="small" data-testid="log-page">
        {t("log.page", { at: Math.ceil(start / PAGE) + 1, pages })}
      </span>
      {buttons.map(({ name, Icon, to, off }) => (
        <button
          key={name}
          type="button"
          className="icon-button"
          aria-label={t(`log.${name}`)}
          title={t(`log.${name}`)}
          data-testid={`log-${name}`}
          disabled={off}
          onClick={() => go(to)}
        >
          <Icon aria-hidden />
        </button>
      ))}
    </nav>
  );
}

function Export({ sessionId, empty }: { sessionId: string; empty: boolean }) {
  const { t } = useTranslation();
  const [busy, setBusy] = useState(false);
  const save = async (): Promise<void> => {
    setBusy(true);
    try {
      const state = getState();
      const title = state.conversations[sessionId]?.title ?? null;
      download(await exportEvents(sessionId), fileName(robotName(state), title, sessionId, new Date()));
    } catch {
      toast("warning", t("log.exportFailed"));
    } finally {
      setBusy(false);
    }
  };
  return (
    <button
      type="button"
      className="button"
      data-testid="log-export"
      title={t("log.exportHint")}
      disabled={busy || empty}
      onClick={() => void save()}
    >
      <Download aria-hidden /> {t("log.export")}
    </button>
  );
}

function download(file: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(file);
  link.download = name;
  link.click();
  // The browser has started the download when this task is done.
  setTimeout(() => URL.revokeObjectURL(link.href), 0);
}
