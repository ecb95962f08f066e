/**
 * Ties the page to the robot, for every screen: login, the connection to the agent, and the health of the parts behind
 * the bridge. A screen starts the connection once somebody is logged in, and ends it with itself.
 */
import type { ClientContext, InitializeResponse } from "@agentclientprotocol/sdk";
import * as http from "../../api/http";
import { keepHidden } from "../../state/alerts";
import { getState, INITIAL, setState, type LoginProblem } from "../../state/store";
import type { Me } from "../../wire/bridge";
import type { Person } from "../../wire/people";
import { announcesTelemetry, resumesAfterEvent, type Telemetry } from "../../wire/telemetry";
import { takeToken } from "../sessions/address";
import { forgetAskedCalls } from "../sessions/questions";
import { forgetPrompts, receiveUpdate } from "../sessions/sessions";
import { setAgent } from "./agent";
import { Link, type LinkEvents } from "./link";
import { Poll } from "./poll";
import { telemetryKnowsStop } from "./stop";
import {
  endTelemetry,
  endTelemetryWatch,
  expectNoTelemetry,
  expectTelemetry,
  startTelemetryWatch,
} from "./telemetry-watch";

const CHECK_MS = 5000;
/** After so many checks in a row without an answer the connection counts as dead. */
const FAILED_CHECKS = 2;

/** What a screen does with the connection. */
export interface Screen {
  /** The agent answers; the connection counts as good when this has resolved. */
  onOpen: (agent: ClientContext, initialized: InitializeResponse) => Promise<void>;
  onQuestion: LinkEvents["onQuestion"];
  onTelemetry?: (telemetry: Telemetry) => void;
  onPeople?: (people: Person[]) => void;
  /** The login ends. The agent can still be notified, if it was connected. */
  onSignOut?: () => void;
}

let activeScreen: Screen | null = null;
let link: Link | null = null;
const checks = new Poll(checkBridge, CHECK_MS);
/** Counts checks in a row that nobody answered. */
let failedChecks = 0;
/** Counts logins, logouts and connections: an answer to what was asked before the newest of them counts for nothing. */
let generation = 0;
/** Logins that wait for their answer. */
let loggingIn = 0;

/** On loading the page: signs in with a token in the address, else with the cookie of an earlier login. */
export async function signInOnLoad(): Promise<void> {
  const token = takeToken();
  if (token !== null) return logIn(token);
  if (loggingIn > 0) return; // the cookie of before must not decide over it
  const asked = ++generation;
  try {
    const { me } = await http.whoAmI();
    if (asked === generation) await signIn(me);
  } catch (error) {
    if (asked !== generation) return;
    const refused = error instanceof http.HttpError && error.status === 401;
    await signOut(refused ? "none" : "unreachable");
  }
}

export async function logIn(token: string): Promise<void> {
  const asked = ++generation;
  loggingIn++;
  try {
    const me = await http.login(token);
    if (asked === generation) await signIn(me);
  } catch (error) {
    if (asked !== generation) return;
    await signOut(problemOf(error instanceof http.HttpError ? error.status : 0));
  } finally {
    loggingIn--;
  }
}

/** What the status of a refused login means; 0 where nobody answered. */
function problemOf(status: number): LoginProblem {
  if (status === 429) return "tooMany";
  return status >= 400 && status < 500 ? "invalid" : "unreachable";
}

export async function logOut(): Promise<void> {
  const asked = ++generation;
  await endScreen();
  await http.logout().catch(() => undefined);
  if (asked === generation) await signOut("none");
}

/** One person in one role: a connection keeps the role with which it was opened. */
export const identityOf = (me: Me): string => `${me.role} ${me.name}`;

/** Another person than before begins with an empty page: nothing of the first one stays in the store. */
async function signIn(me: Me): Promise<void> {
  const asked = ++generation;
  const { auth } = getState();
  const someoneElse = auth.status === "in" && identityOf(auth.me) !== identityOf(me);
  if (someoneElse) await endScreen();
  if (asked === generation) setState({ ...(someoneElse ? INITIAL : {}), auth: { status: "in", me } });
}

async function signOut(problem: LoginProblem): Promise<void> {
  const asked = ++generation;
  await endScreen();
  if (asked === generation) setState({ ...INITIAL, auth: { status: "out", problem } });
}

async function endScreen(): Promise<void> {
  if (activeScreen?.onSignOut !== undefined) {
    activeScreen.onSignOut();
    // Its last messages are still on their way to the socket, and closing that would drop them.
    await new Promise((resolve) => setTimeout(resolve, 0));
  }
  endConnection();
}

export function startConnection(screen: Screen): void {
  if (link !== null) return;
  activeScreen = screen;
  const url = new URL("/acp", window.location.href);
  url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  link = new Link(url.href, {
    onState: (state) => setState({ link: state }),
    onUpdate: receiveUpdate,
    onTelemetry: (telemetry) => {
      receiveTelemetry(telemetry);
      screen.onTelemetry?.(telemetry);
    },
    onPeople: screen.onPeople,
    onQuestion: screen.onQuestion,
    onOpen: (agent, initialized) => {
      setAgent(agent);
      setState({ canResume: resumesAfterEvent(initialized) });
      awaitTelemetry(initialized);
      return screen.onOpen(agent, initialized);
    },
    onLost: () => {
      setAgent(null);
      endTelemetry();
      setState({ people: null });
      checks.soon();
    },
  });
  // Either the robot server hangs or the connection is dead: only the agent's answer tells which.
  startTelemetryWatch(() => void link?.probe());
  link.start();
  checks.now();
  window.addEventListener("online", reconnectNow);
}

export function endConnection(): void {
  activeScreen = null;
  link?.end();
  link = null;
  setAgent(null);
  endTelemetryWatch();
  forgetAskedCalls();
  forgetPrompts();
  checks.end();
  failedChecks = 0;
  window.removeEventListener("online", reconnectNow);
}

export function reconnectNow(): void {
  checks.now();
  const { link: linkState, silentSince } = getState();
  if (linkState.status === "online" && silentSince !== null) link?.drop();
  link?.tryNow();
}

/** The agent's first telemetry may come before the answer to `initialize` has been read. */
function awaitTelemetry(initialized: InitializeResponse): void {
  if (getState().telemetry !== null) return;
  if (announcesTelemetry(initialized)) expectTelemetry();
  else setState({ silentSince: null });
}

function receiveTelemetry(telemetry: Telemetry): void {
  // While the robot is not reachable, the agent says so once and sends nothing more.
  if (telemetry.online) expectTelemetry();
  else expectNoTelemetry();
  const knowsStop = telemetry.online && telemetryKnowsStop();
  setState(({ hidden }) => ({
    telemetry,
    silentSince: null,
    hidden: keepHidden(hidden, telemetry),
    ...(knowsStop ? { stop: telemetry.stop } : {}),
  }));
}

/** Measures the link, and asks whether the login still counts and how the parts behind the bridge are. */
async function checkBridge(signal: AbortSignal): Promise<void> {
  const askedIn = generation;
  const isOld = (): boolean => signal.aborted || askedIn !== generation;
  try {
    const { me, latencyMs, clockOffsetMs } = await http.whoAmI(signal);
    if (isOld()) return;
    failedChecks = 0;
    const { auth } = getState();
    if (auth.status === "in" && (identityOf(auth.me) !== identityOf(me) || auth.me.robot !== me.robot)) {
      await signIn(me);
      return; // the next check is about that login
    }
    setState((state) => ({
      reachable: true,
      latencyMs,
      clockOffsetMs: clockOffsetMs ?? state.clockOffsetMs,
    }));
    const health = await http.health(signal);
    if (!isOld()) setState({ health });
  } catch (error) {
    if (isOld() || !(error instanceof http.HttpError)) return;
    if (error.status === 401) {
      await signOut("expired");
      return;
    }
    if (error.status !== 0) return;
    setState({ reachable: false, latencyMs: null });
    if (++failedChecks >= FAILED_CHECKS) link?.drop();
  }
}
