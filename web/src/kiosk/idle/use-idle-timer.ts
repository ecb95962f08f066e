/** The rest of a kiosk, fed with every touch and key on the page. */
import { useCallback, useEffect, useRef, useState } from "react";
import { Rest } from "./idle-timer";

const WARNING_MS = 20_000;
const TOUCHES = ["pointerdown", "keydown", "input", "wheel", "touchmove"] as const;

export interface RestState {
  /** When the screen starts over, in ms; null while there is no hurry. */
  endsAt: number | null;
  stay: () => void;
}

/** While `held` the time does not count. */
export function useRest(limitMs: number, held: boolean, onOver: () => void): RestState {
  const rest = useRef<Rest | null>(null);
  const [endsAt, setEndsAt] = useState<number | null>(null);

  useEffect(() => {
    const made = new Rest(limitMs, Math.min(WARNING_MS, limitMs / 2), { onWarn: setEndsAt, onOver });
    rest.current = made;
    const touch = (): void => made.touch();
    for (const name of TOUCHES) window.addEventListener(name, touch, { capture: true, passive: true });
    return () => {
      made.end();
      for (const name of TOUCHES) window.removeEventListener(name, touch, { capture: true });
    };
  }, [limitMs, onOver]);

  useEffect(() => rest.current?.hold(held), [held]);

  const stay = useCallback(() => rest.current?.touch(), []);
  return { endsAt, stay };
}
