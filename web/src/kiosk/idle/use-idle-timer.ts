/** The rest of a kiosk, fed with every touch and key on the page. */
import { useCallback, useEffect, useRef, useState } from "react";
import { IdleTimer } from "./idle-timer";

const WARNING_MS = 20_000;
const TOUCHES = ["pointerdown", "keydown", "input", "wheel", "touchmove"] as const;

export interface IdleState {
  /** When the screen starts over, in ms; null while there is no hurry. */
  endsAt: number | null;
  stay: () => void;
}

/** While `held` the time does not count. */
export function useIdleTimer(limitMs: number, held: boolean, onOver: () => void): IdleState {
  const rest = useRef<IdleTimer | null>(null);
  const [endsAt, setEndsAt] = useState<number | null>(null);

  useEffect(() => {
    const made = new IdleTimer(limitMs, Math.min(WARNING_MS, limitMs / 2), { onWarn: setEndsAt, onOver });
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
