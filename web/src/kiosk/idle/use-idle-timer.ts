/** The kiosk's idle timer, restarted by every touch and key on the page. */
import { useCallback, useEffect, useRef, useState } from "react";
import { IdleTimer } from "./idle-timer";

const WARNING_MS = 20_000;
const ACTIVITY = ["pointerdown", "keydown", "input", "wheel", "touchmove"] as const;

export interface IdleState {
  /** When the screen starts over, in ms; null while no warning is due. */
  endsAt: number | null;
  /** Restarts the time. */
  stay: () => void;
}

/** While `paused` no time passes. `onEnd` has to stay the same function. */
export function useIdleTimer(limitMs: number, paused: boolean, onEnd: () => void): IdleState {
  const timer = useRef<IdleTimer | null>(null);
  const [endsAt, setEndsAt] = useState<number | null>(null);

  useEffect(() => {
    const idle = new IdleTimer(limitMs, Math.min(WARNING_MS, limitMs / 2), { onWarn: setEndsAt, onEnd });
    timer.current = idle;
    const restart = (): void => idle.restart();
    for (const name of ACTIVITY) window.addEventListener(name, restart, { capture: true, passive: true });
    return () => {
      idle.dispose();
      for (const name of ACTIVITY) window.removeEventListener(name, restart, { capture: true });
    };
  }, [limitMs, onEnd]);

  useEffect(() => timer.current?.setPaused(paused), [paused]);

  const stay = useCallback(() => timer.current?.restart(), []);
  return { endsAt, stay };
}
