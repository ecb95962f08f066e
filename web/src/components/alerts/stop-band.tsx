/** Who stopped the robot, when, and what releases it, for as long as it is stopped. */
import { OctagonX } from "lucide-react";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { releaseRobot } from "../../acp/connection/stop";
import { clock } from "../../i18n/format";
import { canRelease } from "../../state/rights";
import { robotName, useMe, useStore } from "../../state/store";
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
