/**
 * Notices when the robot's telemetry stops coming. From then on the last telemetry is dropped, because it says nothing of
 * what the robot does now, and the connection is probed, because it may be dead without having been closed. Whether an
 * agent sends telemetry at all is decided in `connection.ts`.
 */
import { setState } from "../../state/store";
import { agentNow } from "./agent-clock";

/** Telemetry comes five times a second: without any for so long, nobody knows what the robot does. */
const SILENCE_MS = 3000;

/** From when on telemetry is expected, by this machine's clock and by the agent's; null while none is expected. */
let expectedSince: { ms: number; at: number } | null = null;
let timer: ReturnType<typeof setTimeout> | undefined;
let wakeListeners: AbortController | null = null;
let onSilence: () => void = () => undefined;

/** `probe` finds out whether the connection is dead; it is called every `SILENCE_MS` for as long as the silence lasts. */
export function startTelemetryWatch(probe: () => void): void {
  onSilence = probe;
  wakeListeners = new AbortController();
  const { signal } = wakeListeners;
  // Timers stop while the machine sleeps, so an old value would stay on the screen for a moment after it wakes.
  for (const event of ["visibilitychange", "resume"])
    document.addEventListener(event, checkAfterSleep, { signal });
  for (const event of ["pageshow", "focus"]) window.addEventListener(event, checkAfterSleep, { signal });
}

export function endTelemetryWatch(): void {
  wakeListeners?.abort();
  expectNoTelemetry();
  setState({ telemetry: null, silentSince: null });
}

/** Telemetry has come, or the agent has announced it: more has to follow. */
export function expectTelemetry(): void {
  expectedSince = { ms: Date.now(), at: agentNow() };
  restartTimer();
}

export function expectNoTelemetry(): void {
  expectedSince = null;
  clearTimeout(timer);
}

/** The connection is lost, so nothing can come. */
export function endTelemetry(): void {
  dropTelemetry();
  expectNoTelemetry();
}

function restartTimer(): void {
  clearTimeout(timer);
  timer = setTimeout(reportSilence, SILENCE_MS);
}

function reportSilence(): void {
  dropTelemetry();
  restartTimer();
  onSilence();
}

function checkAfterSleep(): void {
  if (expectedSince !== null && Date.now() - expectedSince.ms >= SILENCE_MS) reportSilence();
}

/** Old numbers must not pass for what the robot does now. */
function dropTelemetry(): void {
  const since = expectedSince?.at ?? agentNow();
  setState(({ silentSince }) => ({ telemetry: null, silentSince: silentSince ?? since }));
}
