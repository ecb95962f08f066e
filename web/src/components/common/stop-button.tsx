/** Stop: one click, for everyone, on every screen, whatever the connection to the agent does. */
import { OctagonX } from "lucide-react";
import { useTranslation } from "react-i18next";
import { stopRobot } from "../../acp/connection/stop";
import { useStore } from "../../state/store";

export function StopButton() {
  const { t } = useTranslation();
  const busy = useStore((state) => state.stopBusy);
  return (
    <button
      type="button"
      className="stop"
      data-testid="stop"
      aria-label={t("stop.label")}
      aria-busy={busy}
      onClick={() => void stopRobot()}
    >
      <OctagonX aria-hidden />
      <span>{t("stop.button")}</span>
    </button>
  );
}
