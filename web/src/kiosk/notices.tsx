/** Above Stop: that Stop failed, or who stopped the robot and who releases it, or that no request can be taken just now. */
import { DatabaseZap, OctagonAlert, OctagonX } from "lucide-react";
import { useTranslation } from "react-i18next";
import { clock } from "../i18n/format";
import { databaseFailure } from "../state/alerts";
import { robotName, useMe, useStore } from "../state/store";

export function Notices({ onStopAgain }: { onStopAgain: () => void }) {
  const { t } = useTranslation();
  const me = useMe();
  const robot = useStore(robotName);
  const stop = useStore((state) => state.stop);
  const heard = useStore((state) => state.silentSince === null);
  const failed = useStore((state) => state.stopError !== null);
  const noDatabase = useStore((state) => databaseFailure(state) !== null);
  if (failed) {
    return (
      <section className="kiosk-band" role="alert" data-testid="stop-failed">
        <OctagonAlert aria-hidden />
        <p>
          <strong>{t("kiosk.stopFailed")}</strong>
        </p>
        <button type="button" className="button on-danger" onClick={onStopAgain}>
          {t("stop.again")}
        </button>
      </section>
    );
  }
  if (stop === null) return noDatabase ? <NoDatabase /> : null;
  const time = clock(stop.at);
  const here = stop.by === me.name;
  return (
    <section className="kiosk-band" role="alert" data-testid="kiosk-stopped">
      <OctagonX aria-hidden />
      <p>
        <strong>{t(heard ? "kiosk.stopped" : "kiosk.wasStopped", { robot })}</strong>{" "}
        {here ? t("kiosk.stoppedHere", { time }) : t("kiosk.stoppedBy", { name: stop.by, time })}{" "}
        {t(heard ? "kiosk.staffReleases" : "stop.notKnown")}
      </p>
    </section>
  );
}

function NoDatabase() {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  return (
    <section className="kiosk-band kiosk-band-plain" role="status" data-testid="kiosk-database">
      <DatabaseZap aria-hidden />
      <p>{t("kiosk.database", { robot })}</p>
    </section>
  );
}
