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
import { SceneFrame } from "../common/scene-frame";
import { SceneBar } from "./scene-bar";
import type { PickedPoint } from "../../wire/scene";
import { visibleLine } from "../../wire/visible-text";

/** `alone`: the conversation is not on the screen, as on a phone. */
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

  /** Moves the focus into the bar when the element that had it has been removed. */
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
  const openGoHere = (on: boolean): void => {
    setDestination(null);
    setRefused(null);
    setGoing(on);
    pick(on);
  };
  const finishGoHere = (sent: string | null): void => {
    flushSync(() => openGoHere(false));
    focusBar(goButton.current);
    // On other screens the conversation beside the map shows it.
    if (sent !== null && alone) toast("info", t("goHere.sent", { what: sent }));
  };
  return (
    <div className="scene-view">
      <div className="scene-main" inert={large}>
        <div className="scene-bar" ref={bar}>
          {/* One replaces the other, so that the map keeps its place. */}
          {going ? (
            <GoHere
              destination={destination}
              refused={
                refused !== null ? (
                  <span lang="en">{visibleLine(refused)}</span>
                ) : view === null ? (
                  t("goHere.noMap")
                ) : null
              }
              onDestination={setDestination}
              onDone={finishGoHere}
            />
          ) : (
            <SceneBar
              view={view}
              onView={show}
              onGoHere={() => openGoHere(true)}
              goButton={goButton}
              camera={camera}
              cameraButton={cameraButton}
              onCamera={openCamera}
            />
          )}
        </div>
        <div className="scene-map">
          <SceneFrame viewer={VIEWER} />
        </div>
      </div>
      {camera && shown && <CameraView shown={shown} large={large} onLarge={setLarge} onClose={closeCamera} />}
    </div>
  );
}
