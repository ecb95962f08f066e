/** One event of the log in a line. Its content is read from the agent when the row is opened. */
import { ChevronRight } from "lucide-react";
import { memo, useEffect, useState } from "react";
import { useTranslation } from "react-i18next";
import { readEvents } from "../../acp/events/event-pages";
import { clock } from "../../i18n/format";
import type { Row } from "../../state/log-rows";
import { DataView } from "../controls/data-view";
import { isRecord } from "../../wire/fields";

/** Characters of a text that are shown. */
const MAX_TEXT = 600;

export const LogRow = memo(function LogRow(props: { row: Row; name: string; sessionId: string }) {
  const { row, name, sessionId } = props;
  const [open, setOpen] = useState(false);
  const end = useEnd(row);
  const text = end ?? row.text;
  const foreignFrom = end === null ? row.foreignFrom : end.length;
  return (
    <li className="log-row" data-testid="log-row" data-seq={row.seq} data-kind={row.kind}>
      <button type="button" className="log-line" aria-expanded={open} onClick={() => setOpen(!open)}>
        <ChevronRight aria-hidden className="log-mark" />
        <span className="log-number">{row.seq}</span>
        <span className="log-time">{clock(row.at)}</span>
        <span className="log-kind">{name}</span>
        <span className="log-text">
          {text.slice(0, foreignFrom)}
          {foreignFrom < text.length && <span lang="">{text.slice(foreignFrom)}</span>}
        </span>
      </button>
      {open && <Details seq={row.seq} sessionId={sessionId} />}
    </li>
  );
});

const ENDS = ["cancelled", "max_tokens", "max_turn_requests", "refusal", "interrupted"] as const;

/** How a turn ended, in words; empty for a normal end, null for every other kind of row. */
function useEnd({ kind, text }: Row): string | null {
  const { t } = useTranslation();
  if (kind !== "ended") return null;
  const end = ENDS.find((reason) => reason === text);
  return end === undefined ? "" : t(`note.${end}`);
}

function Details({ seq, sessionId }: { seq: number; sessionId: string }) {
  const { t } = useTranslation();
  const [update, setUpdate] = useState<unknown>(undefined);
  const [failed, setFailed] = useState(false);
  useEffect(() => {
    let closed = false;
    readEvents(sessionId, seq - 1, 1).then(
      ({ events }) => !closed && setUpdate(shortened(events[0]?.update)),
      () => !closed && setFailed(true),
    );
    return () => {
      closed = true;
    };
  }, [seq, sessionId]);
  if (failed) return <p className="log-details muted small">{t("log.noDetails")}</p>;
  if (update === undefined) return <p className="log-details muted small">{t("log.reading")}</p>;
  return (
    <div className="log-details details-text" data-testid="log-details">
      <DataView value={update} />
    </div>
  );
}

/** Cuts long texts: pictures and sounds are such texts here, and nobody reads them. */
function shortened(value: unknown): unknown {
  if (typeof value === "string" && value.length > MAX_TEXT) return `${value.slice(0, MAX_TEXT)}…`;
  if (Array.isArray(value)) return value.map(shortened);
  if (!isRecord(value)) return value;
  return Object.fromEntries(Object.entries(value).map(([key, inner]) => [key, shortened(inner)]));
}
