/** Who stopped the robot, when, and what releases it, for as long as it is stopped; and, loudly, that Stop failed. */
import { OctagonAlert, OctagonX, X } from "lucide-react";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { releaseRobot, stopRobot } from "../../acp/connection/connection";
import { clock } from "../../i18n/format";
import { canRelease } from "../../state/rights";
import { robotName, setState, useMe, useStore } from "../../state/store";
import { Confirm } from "../controls/confirm";
import { panes } from "../controls/panes";

export function StopBand() {
  const { t } = useTranslation();
  const stop = useStore((state) => state.stop);
  const heard = useStore((state) => state.silentSince === null);
  const robot = useStore(robotName);
  const me = useMe();
  if (stop === null) return null;
  const time = clock(stop.at);
  return (
    <section className="band band-danger" data-testid="stop-band" role="alert">
      <OctagonX aria-hidden />
      <p>
        <strong>
          {stop.by === me.name
            ? t("stop.stoppedByYou", { time })
            : t("stop.stoppedBy", { name: stop.by, time })}
        </strong>{" "}
        {!heard
          ? t("stop.notKnown")
          : canRelease(me.role)
            ? t("stop.stays", { robot })
            : t("stop.askSupervisor")}
      </p>
      {canRelease(me.role) && <Release robot={robot} />}
    </section>
  );
}

function Release({ robot }: { robot: string }) {
  const { t } = useTranslation();
  const [open, setOpen] = useState(false);
  return (
    <>
      <button type="button" className="button on-danger" data-testid="release" onClick={() => setOpen(true)}>
        {t("stop.release")}
      </button>
      <Confirm
        open={open}
        onOpenChange={setOpen}
        title={t("stop.releaseTitle")}
        text={t("stop.releaseText", { robot })}
        no={t("stop.keep")}
        yes={t("stop.release")}
        onYes={() => void releaseRobot()}
        after={panes}
        testId="release-confirm"
      />
    </>
  );
}

export function StopFailed() {
  const { t } = useTranslation();
  const error = useStore((state) => state.stopError);
  if (error === null) return null;
  return (
    <section className="band band-danger band-loud" data-testid="stop-failed" role="alert">
      <OctagonAlert aria-hidden />
      <p>
        <strong lang={error === "" ? undefined : "en"}>{error === "" ? t("stop.noAnswer") : error}</strong>
      </p>
      <button type="button" className="button on-danger" onClick={() => void stopRobot()}>
        {t("stop.again")}
      </button>
      <button
        type="button"
        className="icon-button"
        aria-label={t("stop.dismiss")}
        onClick={() => {
          panes()?.focus();
          setState({ stopError: null });
        }}
      >
        <X aria-hidden />
      </button>
    </section>
  );
}
