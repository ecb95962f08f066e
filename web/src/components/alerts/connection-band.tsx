/** What cannot be reached right now, the bridge, the agent, the robot or the database, and what happens next. */
import { CloudOff, DatabaseZap, Unplug } from "lucide-react";
import { useTranslation } from "react-i18next";
import { reconnectNow } from "../../acp/connection/connection";
import { clock } from "../../i18n/format";
import { databaseFailure } from "../../state/alerts";
import { useNow } from "../../hooks/use-now";
import { robotName, useStore } from "../../state/store";

export function ConnectionBand() {
  const { t } = useTranslation();
  const link = useStore((state) => state.link);
  const reachable = useStore((state) => state.reachable);
  const agentUp = useStore((state) => state.health?.agent.up ?? true);
  const why = !reachable ? "network" : agentUp ? null : "agent";
  return (
    <section className="band band-plain" data-testid="connection-band">
      <CloudOff aria-hidden />
      <p>
        {/* A screen reader announces the loss and its reason once; the countdown is only to be read. */}
        <span role="status" aria-atomic="false">
          <strong>{t("connection.lost")}</strong> {why !== null && t(`connection.${why}`)}
        </span>{" "}
        {link.status === "waiting" ? <Countdown until={link.retryAt} /> : t("connection.now")}
      </p>
      <ReconnectButton />
    </section>
  );
}

export function RobotBand() {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  return (
    <section className="band band-plain" data-testid="robot-band" role="status">
      <Unplug aria-hidden />
      <p>{t("connection.robot", { robot })}</p>
    </section>
  );
}

/** Agent and robot are there, and everything that needs no conversation goes on. */
export function DatabaseBand() {
  const { t } = useTranslation();
  const since = useStore((state) => databaseFailure(state)?.at ?? null);
  if (since === null) return null;
  return (
    <section className="band band-warn" data-testid="database-band" role="status">
      <DatabaseZap aria-hidden />
      <p>{t("connection.database", { time: clock(since) })}</p>
    </section>
  );
}

/** The connection is open, but no telemetry comes: what was reported last may not be true any more. */
export function SilentBand() {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  return (
    <section className="band band-plain" data-testid="silent-band" role="status">
      <Unplug aria-hidden />
      <p>{t("connection.silent", { robot })}</p>
      <ReconnectButton />
    </section>
  );
}

function ReconnectButton() {
  const { t } = useTranslation();
  return (
    <button type="button" className="button on-plain" onClick={reconnectNow}>
      {t("connection.tryNow")}
    </button>
  );
}

function Countdown({ until }: { until: number }) {
  const { t } = useTranslation();
  const now = useNow(250);
  const count = Math.max(1, Math.ceil((until - now) / 1000));
  return t("connection.again", { count });
}
