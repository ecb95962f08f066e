/**
 * Ties the page to the robot, for every screen: login, the connection to the agent, the health of the parts behind the
 * bridge, and Stop. A screen starts the connection once somebody is logged in, and ends it with itself. Stop goes over
 * HTTP and must never depend on the ACP connection.
 */
import type { ClientContext, InitializeResponse } from "@agentclientprotocol/sdk";
import * as http from "../../api/http";
import i18next from "../../i18n";
import { keepHidden } from "../../state/alerts";
import { getState, INITIAL, setState, toast, type LoginProblem } from "../../state/store";
import type { Me } from "../../wire/bridge";
import type { Person } from "../../wire/people";
import { announcesTelemetry, type Telemetry } from "../../wire/telemetry";
import { takeToken } from "../sessions/address";
import { forgetAskedCalls } from "../sessions/questions";
import { receiveUpdate } from "../sessions/sessions";
import { setAgent } from "./agent";
import { Link, type LinkEvents } from "./link";
import {
  endTelemetry,
  endTelemetryWatch,
  expectNoTelemetry,
  expectTelemetry,
  startTelemetryWatch,
} from "./telemetry-watch";

const CHECK_MS = 5000;
/** Telemetry that was under way while Stop was answered is older than that answer. */
const STOP_SETTLES_MS = 1000;
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
let checkTimer: ReturnType<typeof setInterval> | null = null;
/** When Stop or Release was last answered over HTTP, in ms. */
let stopAnsweredAt = 0;
/** Counts checks in a row that nobody answered. */
let failedChecks = 0;

/** On loading the page: signs in with a token in the address, else with the cookie of an earlier login. */
export async function signInOnLoad(): Promise<void> {
  const token = takeToken();
  if (token !== null) return logIn(token);
  try {
    await signIn((await http.whoAmI()).me);
  } catch (error) {
    const refused = error instanceof http.HttpError && error.status === 401;
    await signOut(refused ? "none" : "unreachable");
  }
}

export async function logIn(token: string): Promise<void> {
  try {
    await signIn(await http.login(token));
  } catch (error) {
    const status = error instanceof http.HttpError ? error.status : 0;
    await signOut(status >= 400 && status < 500 ? "invalid" : "unreachable");
  }
}

export async function logOut(): Promise<void> {
  await endScreen();
  await http.logout().catch(() => undefined);
  await signOut("none");
}

/** One person in one role: a connection keeps the role with which it was opened. */
export const identityOf = (me: Me): string => `${me.role} ${me.name}`;

/** Another person than before begins with an empty page: nothing of the first one stays in the store. */
async function signIn(me: Me): Promise<void> {
  const { auth } = getState();
  const someoneElse = auth.status === "in" && identityOf(auth.me) !== identityOf(me);
  if (someoneElse) await endScreen();
  setState({ ...(someoneElse ? INITIAL : {}), auth: { status: "in", me } });
}

async function signOut(problem: LoginProblem): Promise<void> {
  await endScreen();
  setState({ ...INITIAL, auth: { status: "out", problem } });
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
      awaitTelemetry(initialized);
      return screen.onOpen(agent, initialized);
    },
    onLost: () => {
      setAgent(null);
      endTelemetry();
      setState({ people: null });
      void checkBridge();
    },
  });
  // Either the robot server hangs or the connection is dead: only the agent's answer tells which.
  startTelemetryWatch(() => void link?.probe());
  link.start();
  void checkBridge();
  checkTimer = setInterval(() => void checkBridge(), CHECK_MS);
  window.addEventListener("online", reconnectNow);
}

export function endConnection(): void {
  activeScreen = null;
  link?.end();
  link = null;
  setAgent(null);
  endTelemetryWatch();
  forgetAskedCalls();
  if (checkTimer !== null) clearInterval(checkTimer);
  window.removeEventListener("online", reconnectNow);
}

export function reconnectNow(): void {
  void checkBridge();
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
  const knowsStop = telemetry.online && !getState().stopBusy && Date.now() - stopAnsweredAt > STOP_SETTLES_MS;
  setState(({ hidden }) => ({
    telemetry,
    silentSince: null,
    hidden: keepHidden(hidden, telemetry),
    ...(knowsStop ? { stop: telemetry.stop } : {}),
  }));
}

/** Measures the link, and asks whether the login still counts and how the parts behind the bridge are. */
async function checkBridge(): Promise<void> {
  try {
    const askedWith = link;
    const { me, latencyMs, clockOffsetMs } = await http.whoAmI();
    if (askedWith !== link) return; // the answer is about the login before this one
    failedChecks = 0;
    if (getState().auth.status === "in") await signIn(me);
    setState((state) => ({
      reachable: true,
      latencyMs,
      clockOffsetMs: clockOffsetMs ?? state.clockOffsetMs,
    }));
    const health = await http.health();
    if (askedWith === link) setState({ health });
  } catch (error) {
    if (error instanceof http.HttpError && error.status === 401) {
      await signOut("expired");
      return;
    }
    if (error instanceof http.HttpError && error.status !== 0) return;
    setState({ reachable: false, latencyMs: null });
    if (++failedChecks >= FAILED_CHECKS) link?.drop();
  }
}

/** Stops the robot. Nothing comes before the request, and a failure is shown loudly. */
export async function stopRobot(): Promise<void> {
  setState({ stopBusy: true, stopError: null });
  try {
    const stop = await http.stopRobot();
    stopAnsweredAt = Date.now();
    setState({ stop, stopError: null });
  } catch (error) {
    setState({ stopError: error instanceof http.HttpError ? error.message : "" });
  } finally {
    setState({ stopBusy: false });
  }
}

export async function releaseRobot(): Promise<void> {
  try {
    await http.releaseRobot();
    stopAnsweredAt = Date.now();
    setState({ stop: null });
  } catch (error) {
    const sentence = error instanceof http.HttpError ? error.message : "";
    if (sentence === "") toast("warning", i18next.t("stop.releaseFailed"));
    else toast("warning", sentence, "en");
  }
}
