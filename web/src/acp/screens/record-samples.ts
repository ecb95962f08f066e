/** Follows the robot for the plots: takes at most two samples a second of what telemetry and the link tell. */
import { EVERY_MS, Samples, type Values } from "../../state/samples";
import { useStore, type State } from "../../state/store";

/** Those of this page. */
export const samples = new Samples();

/** Follows the robot; returns what ends it. */
export function recordSamples(): () => void {
  let last = 0;
  return useStore.subscribe((state, before) => {
    if (state.telemetry === before.telemetry && state.latencyMs === before.latencyMs) return;
    const now = Date.now();
    const lost =
      (state.telemetry === null && before.telemetry !== null) ||
      (state.latencyMs === null && before.latencyMs !== null);
    // Telemetry comes five times a second, with a little unrest.
    if (now - last < EVERY_MS - 50 && !lost) return;
    last = now;
    samples.add(now / 1000, valuesOf(state));
  });
}

function valuesOf({ telemetry, latencyMs }: State): Values {
  const speed = telemetry?.online === true ? telemetry.linear : null;
  const battery = telemetry?.online === true ? telemetry.battery : null;
  return {
    speed: speed === null ? null : Math.abs(speed),
    battery: battery === null ? null : battery * 100,
    link: latencyMs,
  };
}
