/** Records what the plots show: at most two samples a second of the robot's speed and battery and of the link's latency. */
import { SAMPLE_MS, Samples, type Values } from "../../state/samples";
import { useStore, type State } from "../../state/store";

/** The samples of this page. */
export const samples = new Samples();

/** Telemetry comes five times a second, not quite evenly: a sample may come so much early. */
const JITTER_MS = 50;

/** Returns a function that ends it. */
export function recordSamples(): () => void {
  let lastAt = 0;
  return useStore.subscribe((state, before) => {
    if (state.telemetry === before.telemetry && state.latencyMs === before.latencyMs) return;
    const now = Date.now();
    const lost =
      (state.telemetry === null && before.telemetry !== null) ||
      (state.latencyMs === null && before.latencyMs !== null);
    if (now - lastAt < SAMPLE_MS - JITTER_MS && !lost) return;
    lastAt = now;
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
