/**
 * Stop and Release. They go over HTTP and must never depend on the ACP connection. Stop counts only when the robot's
 * answer says so; a failure is shown loudly.
 */
import * as http from "../../api/http";
import i18next from "../../i18n";
import { getState, setState, toast, type StopFailure } from "../../state/store";

/** Telemetry that was under way while Stop was answered is older than that answer. */
const STOP_SETTLES_MS = 1000;

/** When Stop or Release was last answered, in ms. */
let answeredAt = 0;
/** Counts the Stops of this page. */
let asked = 0;
/** The number of the last Stop that the robot has confirmed. */
let confirmed = 0;
/** Stops that wait for their answer. */
let waiting = 0;

/** Stops the robot. Nothing comes before the request. */
export async function stopRobot(): Promise<void> {
  const number = ++asked;
  waiting++;
  setState({ stopBusy: true, stopError: null });
  try {
    const stop = await http.stopRobot();
    confirmed = Math.max(confirmed, number);
    answeredAt = Date.now();
    setState({ stop, stopError: null });
  } catch (error) {
    // The late failure of an older Stop says nothing about one that the robot has confirmed since.
    if (confirmed < number) setState({ stopError: failureOf(error) });
  } finally {
    setState({ stopBusy: --waiting > 0 });
  }
}

function failureOf(error: unknown): StopFailure {
  if (error instanceof http.ForeignAnswer) return { kind: "foreign" };
  if (!(error instanceof http.HttpError) || error.message === "") return { kind: "noAnswer" };
  // The bridge's own sentence about a robot that it cannot reach also says what to do.
  return { kind: error.status === 503 ? "told" : "refused", sentence: error.message };
}

export async function releaseRobot(): Promise<void> {
  try {
    await http.releaseRobot();
    answeredAt = Date.now();
    setState({ stop: null });
  } catch (error) {
    const sentence = error instanceof http.HttpError ? error.message : "";
    if (sentence !== "") toast("warning", sentence, "en");
    else toast("warning", i18next.t("stop.releaseFailed"));
  }
}

/** Whether the stop in telemetry that comes now is newer than the last answer. */
export function telemetryKnowsStop(): boolean {
  return !getState().stopBusy && Date.now() - answeredAt > STOP_SETTLES_MS;
}
