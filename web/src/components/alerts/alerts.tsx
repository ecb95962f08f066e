/** The alerts at the top of the screen: stopped, connection lost, halted by itself, battery low. */
import { BatteryWarning, ShieldAlert, X } from "lucide-react";
import { useTranslation } from "react-i18next";
import { useShallow } from "zustand/react/shallow";
import { clock, percent } from "../../i18n/format";
import { alerts, isBelowFloor, type AlertKind } from "../../state/alerts";
import { robotName, setState, useStore, type HiddenAlerts } from "../../state/store";
import { ConnectionBand, DatabaseBand, RobotBand, SilentBand } from "./connection-band";
import { panes } from "../controls/panes";
import { PaneBoundary } from "../common/pane-boundary";
import { StopFailed } from "../common/stop-failed";
import { StopBand } from "./stop-band";
import { visibleLine } from "../../wire/visible-text";

const BANDS: Record<AlertKind, () => React.ReactNode> = {
  "stop-failed": StopFailedBand,
  stopped: StopBand,
  cut: ConnectionBand,
  silent: SilentBand,
  "robot-lost": RobotBand,
  database: DatabaseBand,
  halted: HaltBand,
  battery: BatteryBand,
};

export function Alerts() {
  const { t } = useTranslation();
  const kinds = useStore(useShallow(alerts));
  return (
    <div className="bands" data-testid="alerts">
      {kinds.map((kind) => {
        const Band = BANDS[kind];
        return (
          <PaneBoundary key={kind} name={t("toast.region")}>
            <Band />
          </PaneBoundary>
        );
      })}
    </div>
  );
}

function StopFailedBand() {
  return <StopFailed onDismiss={() => panes()?.focus()} />;
}

function HaltBand() {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  const halted = useStore((state) => state.telemetry?.halted ?? null);
  if (halted === null) return null;
  return (
    <section className="band band-warn" data-testid="halted-band" role="alert">
      <ShieldAlert aria-hidden />
      <p>
        <strong>{t("alerts.halted", { robot, time: clock(halted.at) })}</strong>{" "}
        {/* The robot's own sentences are English. */}
        <span lang="en">{visibleLine(halted.text)}</span> {t("alerts.haltedNext")}
      </p>
      <Hide onClick={() => hide({ halted: halted.at })} />
    </section>
  );
}

function BatteryBand() {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  const level = useStore((state) => state.telemetry?.battery ?? null);
  const onlyHome = useStore((state) => isBelowFloor(state.telemetry));
  if (level === null) return null;
  return (
    <section className="band band-warn" data-testid="battery-band" role="status">
      <BatteryWarning aria-hidden />
      <p>
        <strong>
          {t("alerts.battery")} {/* A screen reader announces the band once, not each percent. */}
          <span aria-live="off">{percent(level)}.</span>
        </strong>{" "}
        {t(onlyHome ? "alerts.batteryOnlyHome" : "alerts.batterySoon", { robot })}
      </p>
      <Hide onClick={() => hide({ battery: level })} />
    </section>
  );
}

function hide(alert: Partial<HiddenAlerts>): void {
  panes()?.focus();
  setState(({ hidden }) => ({ hidden: { ...hidden, ...alert } }));
}

function Hide({ onClick }: { onClick: () => void }) {
  const { t } = useTranslation();
  return (
    <button type="button" className="icon-button" aria-label={t("alerts.hide")} onClick={onClick}>
      <X aria-hidden />
    </button>
  );
}
