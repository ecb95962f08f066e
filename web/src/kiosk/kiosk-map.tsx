/** The live map, small and without controls, where the screen has room for it. */
import { useSyncExternalStore } from "react";
import { useTranslation } from "react-i18next";
import { SceneFrame } from "../components/common/scene-frame";
import { robotName, useStore } from "../state/store";

const ROOM = window.matchMedia("(min-width: 700px) and (min-height: 900px)");

function subscribe(changed: () => void): () => void {
  ROOM.addEventListener("change", changed);
  return () => ROOM.removeEventListener("change", changed);
}

export function KioskMap() {
  const { t } = useTranslation();
  const robot = useStore(robotName);
  const fits = useSyncExternalStore(subscribe, () => ROOM.matches);
  if (!fits) return null;
  return (
    <figure className="kiosk-map">
      <div className="scene-view" inert>
        <SceneFrame />
      </div>
      <figcaption>{t("kiosk.map", { robot })}</figcaption>
    </figure>
  );
}
