/**
 * What the turn spends its time on: a bar that grows while the turn runs, and the seconds in words and numbers. It stands
 * still while telemetry is missing, because nobody knows then whether the turn runs.
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
        <TimelineDetails
          timeline={timeline}
          now={timeline.ended}
          state={timeline.measured ? "measured" : "seen"}
        />
      ) : silentSince !== null ? (
        <TimelineDetails timeline={timeline} now={silentSince} state="lost" />
      ) : (
        <RunningTimeline timeline={timeline} />
      )}
    </section>
  );
}

function RunningTimeline({ timeline }: { timeline: Timeline }) {
  useNow(GROW_MS);
  return <TimelineDetails timeline={timeline} now={agentNow()} state="running" />;
}

const CAPTIONS = {
  running: "timeline.soFar",
  lost: "timeline.lost",
  measured: "timeline.measured",
  seen: "timeline.seen",
} as const;
type TimelineState = keyof typeof CAPTIONS;

function TimelineDetails({
  timeline,
  now,
  state,
}: {
  timeline: Timeline;
  now: number;
  state: TimelineState;
}) {
  const { t } = useTranslation();
  const phases = timeline.measured ?? secondsAt(timeline, now);
  return (
    <>
      <Bar timeline={timeline} now={now} phases={phases} />
      <PhaseTable phases={phases} caption={t(CAPTIONS[state])} state={state} />
    </>
  );
}

function Bar({ timeline, now, phases }: { timeline: Timeline; now: number; phases: Seconds }) {
  const { t } = useTranslation();
  const lengths = lengthsAt(timeline, now);
  const all = lengths.reduce((sum, { seconds }) => sum + seconds, 0);
  const words = PHASES.filter((phase) => phases[phase] > 0)
    .map((phase) => `${t(`phase.${phase}`)} ${inSeconds(phases[phase])}`)
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

function PhaseTable({ phases, caption, state }: { phases: Seconds; caption: string; state: string }) {
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
        {PHASES.filter((phase) => phases[phase] > 0).map((phase) => (
          <tr key={phase} data-testid={`phase-${phase}`} data-seconds={phases[phase]}>
            <th scope="row">
              <span className="turn-swatch" data-phase={phase} aria-hidden="true" />
              {t(`phase.${phase}`)}
            </th>
            <td>{t("timeline.value", { value: fixed(phases[phase], 2) })}</td>
            <td className="muted">{percent(phases.total > 0 ? phases[phase] / phases.total : 0)}</td>
          </tr>
        ))}
      </tbody>
      <tfoot>
        <tr data-testid="phase-total" data-seconds={phases.total}>
          <th scope="row">{t("phase.total")}</th>
          <td>{t("timeline.value", { value: fixed(phases.total, 2) })}</td>
          <td />
        </tr>
      </tfoot>
    </table>
  );
}
