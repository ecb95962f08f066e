/** The camera's picture, in a corner of the map or over all of it. An old picture never passes for a new one. */
import { Maximize2, Minimize2, VideoOff, X } from "lucide-react";
import type { KeyboardEvent } from "react";
import { useTranslation } from "react-i18next";
import { useCamera } from "../../hooks/use-camera";
import { usePageVisible } from "../../hooks/use-page-visible";
import { robotName, useStore } from "../../state/store";

export interface CameraViewProps {
  /** Whether its pane is on the screen. */
  shown: boolean;
  large: boolean;
  onLarge: (large: boolean) => void;
  onClose: () => void;
}

export function CameraView({ shown, large, onLarge, onClose }: CameraViewProps) {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  const away = useStore((state) => state.telemetry?.online === false);
  const visible = usePageVisible();
  const { state, url, onDecoded } = useCamera(shown && visible);
  const Size = large ? Minimize2 : Maximize2;
  const onKeyDown = (event: KeyboardEvent): void => {
    if (event.key === "Escape" && large) onLarge(false);
  };
  return (
    // Escape goes back to the map; there is a button for it, too.
    // eslint-disable-next-line jsx-a11y/no-noninteractive-element-interactions
    <section
      className="camera"
      aria-label={t("camera.title")}
      data-testid="camera-view"
      data-large={large}
      data-state={state}
      onKeyDown={onKeyDown}
    >
      <div className="camera-head">
        <h2>{t("camera.title")}</h2>
        {state === "live" && <span className="camera-live">{t("camera.live")}</span>}
        <button
          type="button"
          className="icon-button"
          data-testid="camera-size"
          aria-label={t(large ? "camera.shrink" : "camera.enlarge")}
          onClick={() => onLarge(!large)}
        >
          <Size aria-hidden />
        </button>
        <button type="button" className="icon-button" aria-label={t("camera.close")} onClick={onClose}>
          <X aria-hidden />
        </button>
      </div>
      <div className="camera-frame">
        {url !== null ? (
          <img
            src={url}
            alt={t("camera.picture", { robot })}
            data-testid="camera-picture"
            onLoad={onDecoded}
            onError={onDecoded}
          />
        ) : (
          <p className="camera-none" role="status">
            {state === "none" && <VideoOff aria-hidden />}
            {state === "none" && away ? t("camera.away", { robot }) : t(`camera.${state}`)}
          </p>
        )}
      </div>
    </section>
  );
}
