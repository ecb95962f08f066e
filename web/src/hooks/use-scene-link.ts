/** The control socket of the scene, for components: open for as long as the map is. */
import { useCallback, useEffect, useRef, useState } from "react";
import { newViewerId, SceneLink } from "../scene/scene-link";
import { useStore } from "../state/store";
import type { PickedPoint, ShownView, View } from "../wire/scene";

/** The name of this page as a viewer; the same for each of its connections. */
export const VIEWER = newViewerId();

export interface SceneControl {
  /** Where the camera stands; null while the scene is not connected. */
  view: ShownView | null;
  show: (view: View) => void;
  pick: (on: boolean) => void;
}

/** `onPicked` and `onRefused` have to stay the same functions. */
export function useSceneLink(
  onPicked: (picked: PickedPoint) => void,
  onRefused: (sentence: string) => void,
): SceneControl {
  const link = useRef<SceneLink | null>(null);
  const [view, setView] = useState<ShownView | null>(null);
  const reachable = useStore((state) => state.reachable);

  useEffect(() => {
    const made = new SceneLink(VIEWER, { onView: setView, onPicked, onRefused });
    link.current = made;
    return () => {
      link.current = null;
      made.end();
    };
  }, [onPicked, onRefused]);

  // A browser does not notice that a network cable was pulled out.
  useEffect(() => {
    if (!reachable) link.current?.drop();
  }, [reachable]);

  return {
    view,
    show: useCallback((wanted: View) => link.current?.show(wanted), []),
    pick: useCallback((on: boolean) => link.current?.pick(on), []),
  };
}
