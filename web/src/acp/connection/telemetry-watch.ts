/**
 * Whether the robot is heard. Once it is not, what was told last says nothing of it any more, and the line is asked
 * whether it is dead. Whether a robot that is away tells anything is not decided here.
 */
import { setState } from "../../state/store";
import { agentNow } from "./agent-clock";

/** Telemetry comes five times a second: without it for so long, nobody knows what the robot does. */
const SILENCE_MS = 3000;

/** Since when telemetry has to come, by this machine's clock and by the agent's; null while none has to. */
let since: { ms: number; at: number } | null = null;
let timer: ReturnType<typeof setTimeout> | undefined;
let listening: AbortController | null = null;
let onSilence: () => void = () => undefined;

/** `asks` finds out whether the line is dead; called as long as nothing is heard. */
export function startHearing(asks: () => void): void {
  onSilence = asks;
  listening = new AbortController();
  const { signal } = listening;
  // A timer sleeps with the machine: what was told before must not pass for now until it is awake.
  for (const woken of ["visibilitychange", "resume"]) document.addEventListener(woken, wake, { signal });
  for (const woken of ["pageshow", "focus"]) window.addEventListener(woken, wake, { signal });
}

export function endHearing(): void {
  listening?.abort();
  expectNothing();
  setState({ telemetry: null, heardUntil: null });
}

/** Telemetry was heard or promised just now: more has to come. */
export function expectMore(): void {
  since = { ms: Date.now(), at: agentNow() };
  arm();
}

export function expectNothing(): void {
  since = null;
  clearTimeout(timer);
}

/** The line is lost. */
export function hearNothing(): void {
  forget();
  expectNothing();
}

function arm(): void {
  clearTimeout(timer);
  timer = setTimeout(fallSilent, SILENCE_MS);
}

function fallSilent(): void {
  forget();
  arm();
  onSilence();
}

function wake(): void {
  if (since !== null && Date.now() - since.ms >= SILENCE_MS) fallSilent();
}

/** Old numbers must not pass for what the robot does now. */
function forget(): void {
  const until = since?.at ?? agentNow();
  setState(({ heardUntil }) => ({ telemetry: null, heardUntil: heardUntil ?? until }));
}
