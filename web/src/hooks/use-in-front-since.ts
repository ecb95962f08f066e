/**
 * When the page last came to the front, in ms of `performance.now()`: a click that raises the window is not meant for what
 * it hits. A change causes no render.
 */
import { useEffect, useRef, type RefObject } from "react";
import { isInFront } from "../attention/notification";

/** The map's frame takes the focus from the page without an event when it leaves, so the page also polls. */
const POLL_MS = 250;

export function useInFrontSince(): RefObject<number> {
  const since = useRef(0);
  useEffect(() => {
    since.current = performance.now();
    let behind = !isInFront();
    const check = (): void => {
      if (behind && isInFront()) since.current = performance.now();
      behind = !isInFront();
    };
    const timer = setInterval(check, POLL_MS);
    for (const event of ["focus", "blur"]) window.addEventListener(event, check);
    document.addEventListener("visibilitychange", check);
    return () => {
      clearInterval(timer);
      for (const event of ["focus", "blur"]) window.removeEventListener(event, check);
      document.removeEventListener("visibilitychange", check);
    };
  }, []);
  return since;
}
