/** The live map with its buttons and the camera's picture. */
import { useCallback, useRef, useState } from "react";
import { flushSync } from "react-dom";
import { useTranslation } from "react-i18next";
import { useSceneLink, VIEWER } from "../../hooks/use-scene-link";
import { storeCameraChoice, storedCameraChoice } from "../../scene/camera-choice";
import { destinationOf, type Destination } from "../../scene/destination";
import { toast } from "../../state/store";
import { CameraView } from "./camera-view";
import { GoHere } from "./go-here";
import { Scene } from "../shared/scene-frame";
import { SceneBar } from "./scene-bar";
import type { PickedPoint } from "../../wire/scene";

/** `alone`: nothing else is on the screen, as on a phone. */
export function SceneView({ shown, alone }: { shown: boolean; alone: boolean }) {
  const { t } = useTranslation();
  const [camera, setCamera] = useState(() => storedCameraChoice() ?? !alone);
  const [large, setLarge] = useState(false);
  const [going, setGoing] = useState(false);
  const [destination, setDestination] = useState<Destination | null>(null);
  const [refused, setRefused] = useState<string | null>(null);
  const goButton = useRef<HTMLButtonElement>(null);
  const cameraButton = useRef<HTMLButtonElement>(null);
  const bar = useRef<HTMLDivElement>(null);
  const onPicked = useCallback((picked: PickedPoint) => setDestination(destinationOf(picked)), []);
  const { view, show, pick } = useSceneLink(onPicked, setRefused);

  /** The keyboard goes on in the bar when what had it has left the screen. */
  const focusBar = (wanted: HTMLButtonElement | null): void => {
    const first = bar.current?.querySelector<HTMLElement>("button:enabled, select:enabled");
    (wanted?.disabled === false ? wanted : first)?.focus();
  };
  const openCamera = (open: boolean): void => {
    storeCameraChoice(open);
    setCamera(open);
    setLarge(false);
  };
  const closeCamera = (): void => {
    flushSync(() => openCamera(false));
    focusBar(cameraButton.current);
  };
  const go = (on: boolean): void => {
    setDestination(null);
    setRefused(null);
    setGoing(on);
    pick(on);
  };
  const over = (asked: string | null): void => {
    flushSync(() => go(false));
    focusBar(goButton.current);
    // Elsewhere the conversation beside the map shows it.
    if (asked !== null && alone) toast("info", t("goHere.sent", { what: asked }));
  };
  return (
    <div className="scene-view">
      <div className="scene-main" inert={large}>
        <div className="scene-bar" ref={bar}>
          {/* One takes the other's place, so that the map stays as it is. */}
          {going ? (
            <GoHere
              destination={destination}
              refused={
                refused !== null ? <span lang="en">{refused}</span> : view === null ? t("goHere.noMap") : null
              }
              onDestination={setDestination}
              onOver={over}
            />
          ) : (
            <SceneBar
              view={view}
              onView={show}
              onGoHere={() => go(true)}
              goButton={goButton}
              camera={camera}
              cameraButton={cameraButton}
              onCamera={openCamera}
            />
          )}
        </div>
        <div className="scene-map">
          <Scene viewer={VIEWER} />
        </div>
      </div>
      {camera && shown && <CameraView shown={shown} large={large} onLarge={setLarge} onClose={closeCamera} />}
    </div>
  );
}
