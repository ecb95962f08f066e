/** The buttons over the map: its views, "Go here", and the robot's camera. */
import { Camera, LocateFixed, Map, MapPin, ScanEye } from "lucide-react";
import { useId, type Ref } from "react";
import { useTranslation } from "react-i18next";
import { canPrompt } from "../../state/rights";
import { useMe } from "../../state/store";
import { VIEWS, type ShownView, type View } from "../../wire/scene";

const ICONS = { follow: LocateFixed, top: ScanEye, map: Map };

export interface SceneBarProps {
  view: ShownView | null;
  onView: (view: View) => void;
  onGoHere: () => void;
  goButton: Ref<HTMLButtonElement>;
  camera: boolean;
  cameraButton: Ref<HTMLButtonElement>;
  onCamera: (open: boolean) => void;
}

export function SceneBar(props: SceneBarProps) {
  const { view: shown, onView, onGoHere, goButton, camera, cameraButton, onCamera } = props;
  const { t } = useTranslation();
  const me = useMe();
  const reasonId = useId();
  const away = shown === null;
  return (
    <div className="scene-tools">
      <div className="scene-views" role="group" aria-label={t("view.label")}>
        {VIEWS.map((view) => {
          const Icon = ICONS[view];
          return (
            <button
              key={view}
              type="button"
              className="scene-tool"
              data-testid={`view-${view}`}
              aria-pressed={shown === view}
              // Not `disabled`: when the map is lost, the focus must stay on the button.
              aria-disabled={away}
              aria-describedby={reasonId}
              onClick={() => {
                if (!away) onView(view);
              }}
            >
              <Icon aria-hidden /> {t(`view.${view}`)}
            </button>
          );
        })}
      </div>
      {canPrompt(me.role) && (
        <button
          type="button"
          className="scene-tool single"
          data-testid="go-here"
          ref={goButton}
          onClick={onGoHere}
        >
          <MapPin aria-hidden /> {t("goHere.button")}
        </button>
      )}
      <button
        type="button"
        className="scene-tool single scene-tool-last"
        data-testid="camera"
        ref={cameraButton}
        aria-label={t("camera.title")}
        aria-pressed={camera}
        onClick={() => onCamera(!camera)}
      >
        <Camera aria-hidden /> <span className="scene-tool-word">{t("camera.title")}</span>
      </button>
      <p className="scene-problem muted" id={reasonId}>
        {away && t("view.away")}
      </p>
    </div>
  );
}
