/**
 * When the page last came to the front, in ms of `performance.now()`: a click that raises its window is meant for the
 * window. Nothing is drawn for it.
 */
import { useEffect, useRef, type RefObject } from "react";
import { isInFront } from "../attention/notification";

/** The page's own frames take the focus, too, and then only looking tells when the window goes behind another one. */
const LOOK_MS = 250;

export function useInFrontSince(): RefObject<number> {
  const since = useRef(0);
  useEffect(() => {
    since.current = performance.now();
    let behind = !isInFront();
    const look = (): void => {
      if (behind && isInFront()) since.current = performance.now();
      behind = !isInFront();
    };
    const timer = setInterval(look, LOOK_MS);
    for (const event of ["focus", "blur"]) window.addEventListener(event, look);
    document.addEventListener("visibilitychange", look);
    return () => {
      clearInterval(timer);
      for (const event of ["focus", "blur"]) window.removeEventListener(event, look);
      document.removeEventListener("visibilitychange", look);
    };
  }, []);
  return since;
}
