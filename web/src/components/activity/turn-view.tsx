/**
 * Where the time of the turn goes: a bar that grows while the turn runs, and the seconds in words and numbers. It stands
 * still while nobody knows whether the turn runs.
 */
import { useTranslation } from "react-i18next";
import { agentNow } from "../../acp/connection/agent-clock";
import { useNow } from "../../hooks/use-now";
import { fixed, percent, seconds as inSeconds } from "../../i18n/format";
import { PHASES, type Seconds } from "../../wire/phases";
import { useStore } from "../../state/store";
import { lengthsAt, secondsAt, type Timeline } from "../../state/conversation/timeline";

const GROW_MS = 250;

export function TurnView() {
  const { t } = useTranslation();
  const timeline = useStore((state) =>
    state.currentId === null ? null : (state.conversations[state.currentId]?.timeline ?? null),
  );
  const silentSince = useStore((state) => state.silentSince);
  return (
    <section className="turn" aria-label={t("timeline.title")} data-testid="timeline">
      {timeline === null ? (
        <p className="muted small">{t("timeline.none")}</p>
      ) : timeline.ended !== null ? (
        <Shown timeline={timeline} now={timeline.ended} state={timeline.measured ? "measured" : "seen"} />
      ) : silentSince !== null ? (
        <Shown timeline={timeline} now={silentSince} state="lost" />
      ) : (
        <Growing timeline={timeline} />
      )}
    </section>
  );
}

function Growing({ timeline }: { timeline: Timeline }) {
  useNow(GROW_MS);
  return <Shown timeline={timeline} now={agentNow()} state="running" />;
}

const CAPTIONS = {
  running: "timeline.soFar",
  lost: "timeline.lost",
  measured: "timeline.measured",
  seen: "timeline.seen",
} as const;
type Shows = keyof typeof CAPTIONS;

function Shown({ timeline, now, state }: { timeline: Timeline; now: number; state: Shows }) {
  const { t } = useTranslation();
  const told = timeline.measured ?? secondsAt(timeline, now);
  return (
    <>
      <Bar timeline={timeline} now={now} told={told} />
      <PhaseTable told={told} caption={t(CAPTIONS[state])} state={state} />
    </>
  );
}

function Bar({ timeline, now, told }: { timeline: Timeline; now: number; told: Seconds }) {
  const { t } = useTranslation();
  const lengths = lengthsAt(timeline, now);
  const all = lengths.reduce((sum, { seconds }) => sum + seconds, 0);
  const words = PHASES.filter((phase) => told[phase] > 0)
    .map((phase) => `${t(`phase.${phase}`)} ${inSeconds(told[phase])}`)
    .join(", ");
  return (
    <div className="turn-bar" role="img" aria-label={t("timeline.bar", { phases: words })}>
      {lengths.map(({ phase, seconds }, index) => (
        <span
          key={index}
          className="turn-part"
          data-testid="timeline-part"
          data-phase={phase}
          title={`${t(`phase.${phase}`)} ${inSeconds(seconds)}`}
          style={{ flexGrow: seconds }}
        >
          {seconds > all * 0.14 && t(`phase.${phase}`)}
        </span>
      ))}
    </div>
  );
}

function PhaseTable({ told, caption, state }: { told: Seconds; caption: string; state: string }) {
  const { t } = useTranslation();
  return (
    <table className="turn-table" data-testid="phases" data-state={state}>
      <caption>{caption}</caption>
      <thead className="sr-only">
        <tr>
          <th scope="col">{t("timeline.phase")}</th>
          <th scope="col">{t("timeline.seconds")}</th>
          <th scope="col">{t("timeline.share")}</th>
        </tr>
      </thead>
      <tbody>
        {PHASES.filter((phase) => told[phase] > 0).map((phase) => (
          <tr key={phase} data-testid={`phase-${phase}`} data-seconds={told[phase]}>
            <th scope="row">
              <span className="turn-swatch" data-phase={phase} aria-hidden="true" />
              {t(`phase.${phase}`)}
            </th>
            <td>{t("timeline.value", { value: fixed(told[phase], 2) })}</td>
            <td className="muted">{percent(told.total > 0 ? told[phase] / told.total : 0)}</td>
          </tr>
        ))}
      </tbody>
      <tfoot>
        <tr data-testid="phase-total" data-seconds={told.total}>
          <th scope="row">{t("phase.total")}</th>
          <td>{t("timeline.value", { value: fixed(told.total, 2) })}</td>
          <td />
        </tr>
      </tfoot>
    </table>
  );
}
