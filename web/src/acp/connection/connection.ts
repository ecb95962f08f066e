/**
 * Ties the page to the robot, for every screen: login, the connection, the health of the parts, Stop. Started once when
 * somebody is logged in, ended when nobody is. Stop goes over HTTP and must never depend on the ACP connection.
 */
import type { ClientContext, InitializeResponse } from "@agentclientprotocol/sdk";
import * as http from "../../api/http";
import i18next from "../../i18n";
import { stillHidden } from "../../state/alerts";
import { getState, INITIAL, setState, toast, type LoginProblem } from "../../state/store";
import { takeToken } from "../sessions/address";
import { endHearing, expectMore, expectNothing, hearNothing, startHearing } from "./telemetry-watch";
import { Link, type LinkEvents } from "./link";
import type { Person } from "../../wire/people";
import { forgetAsked } from "../sessions/questions";
import { receive, setAgent } from "../sessions/sessions";
import { tellsOfRobot, type Telemetry } from "../../wire/telemetry";

const CHECK_MS = 5000;
const TOLD_MS = 1000;

/** What a screen makes of the connection. */
export interface Screen {
  /** The agent answers; the connection counts as good when this has resolved. */
  onOpen: (agent: ClientContext, hello: InitializeResponse) => Promise<void>;
  onQuestion: LinkEvents["onQuestion"];
  onTelemetry?: (telemetry: Telemetry) => void;
  onPeople?: (people: Person[]) => void;
  /** The login ends, and the agent can still be told, where it is there. */
  onLeave?: () => void;
}

let shown: Screen | null = null;
let link: Link | null = null;
let checks: ReturnType<typeof setInterval> | null = null;
/** When Stop or Release was last answered over HTTP; telemetry that was under way then is older. */
let toldAt = 0;
/** Counts checks in a row that nobody answered; the second one takes the connection for dead. */
let unanswered = 0;

/** On loading the page: a token in the address, else the cookie of an earlier login. */
export async function begin(): Promise<void> {
  const token = takeToken();
  if (token !== null) return logIn(token);
  try {
    await enter((await http.whoAmI()).me);
  } catch (error) {
    const refused = error instanceof http.HttpError && error.status === 401;
    await leave(refused ? "none" : "unreachable");
  }
}

export async function logIn(token: string): Promise<void> {
  try {
    await enter(await http.login(token));
  } catch (error) {
    const status = error instanceof http.HttpError ? error.status : 0;
    await leave(status >= 400 && status < 500 ? "invalid" : "unreachable");
  }
}

export async function logOut(): Promise<void> {
  await finish();
  await http.logout().catch(() => undefined);
  await leave("none");
}

/** One person in one role: a connection keeps the role with which it was opened. */
export const keyOf = (me: http.Me): string => `${me.role} ${me.name}`;

/** Who comes in the place of somebody else finds nothing of theirs: what they had read may be news to this one. */
async function enter(me: http.Me): Promise<void> {
  const { auth } = getState();
  const other = auth.status === "in" && keyOf(auth.me) !== keyOf(me);
  if (other) await finish();
  setState({ ...(other ? INITIAL : {}), auth: { status: "in", me } });
}

async function leave(problem: LoginProblem): Promise<void> {
  await finish();
  setState({ ...INITIAL, auth: { status: "out", problem } });
}

/** The end of what was shown to whoever was logged in. */
async function finish(): Promise<void> {
  if (shown?.onLeave !== undefined) {
    shown.onLeave();
    // What it told the agent is still on its way to the socket, and closing that would drop it.
    await new Promise((resolve) => setTimeout(resolve, 0));
  }
  end();
}

export function start(screen: Screen): void {
  if (link !== null) return;
  shown = screen;
  const url = new URL("/acp", window.location.href);
  url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
  link = new Link(url.href, {
    onState: (state) => setState({ link: state }),
    onUpdate: receive,
    onTelemetry: (telemetry) => {
      takeTelemetry(telemetry);
      screen.onTelemetry?.(telemetry);
    },
    onPeople: screen.onPeople,
    onQuestion: screen.onQuestion,
    onOpen: (agent, hello) => {
      setAgent(agent);
      awaitTelemetry(hello);
      return screen.onOpen(agent, hello);
    },
    onLost: () => {
      setAgent(null);
      hearNothing();
      setState({ people: null });
      void check();
    },
  });
  // The robot's server hangs, or the line is dead without having been closed: an answer of the agent tells which.
  startHearing(() => void link?.probe());
  link.start();
  void check();
  checks = setInterval(() => void check(), CHECK_MS);
  window.addEventListener("online", tryNow);
}

export function end(): void {
  shown = null;
  link?.end();
  link = null;
  setAgent(null);
  endHearing();
  forgetAsked();
  if (checks !== null) clearInterval(checks);
  window.removeEventListener("online", tryNow);
}

export function tryNow(): void {
  void check();
  const { link: line, heardUntil } = getState();
  if (line.status === "online" && heardUntil !== null) link?.drop();
  link?.tryNow();
}

/** An open line says nothing of the robot yet, and what an agent tells of it may have come before its hello was read. */
function awaitTelemetry(hello: InitializeResponse): void {
  if (getState().telemetry !== null) return;
  if (tellsOfRobot(hello)) expectMore();
  else setState({ heardUntil: null });
}

function takeTelemetry(telemetry: Telemetry): void {
  // Of a robot that is not reachable the agent tells once.
  if (telemetry.online) expectMore();
  else expectNothing();
  const current = telemetry.online && !getState().stopBusy && Date.now() - toldAt > TOLD_MS;
  setState(({ hidden }) => ({
    telemetry,
    heardUntil: null,
    hidden: stillHidden(hidden, telemetry),
    ...(current ? { stop: telemetry.stop } : {}),
  }));
}

/** How quick the link is, whether the login still counts, and how the parts behind the bridge are. */
async function check(): Promise<void> {
  try {
    const asked = link;
    const { me, latencyMs, clockOffsetMs } = await http.whoAmI();
    if (asked !== link) return; // it was said of whoever was here before
    unanswered = 0;
    if (getState().auth.status === "in") await enter(me);
    setState((state) => ({
      reachable: true,
      latencyMs,
      clockOffsetMs: clockOffsetMs ?? state.clockOffsetMs,
    }));
    const health = await http.health();
    if (asked === link) setState({ health });
  } catch (error) {
    if (error instanceof http.HttpError && error.status === 401) {
      await leave("expired");
      return;
    }
    if (error instanceof http.HttpError && error.status !== 0) return;
    setState({ reachable: false, latencyMs: null });
    if (++unanswered >= 2) link?.drop();
  }
}

/** Stops the robot. Nothing comes before it, and a failure is said loudly. */
export async function stopRobot(): Promise<void> {
  setState({ stopBusy: true, stopError: null });
  try {
    const stop = await http.stopRobot();
    toldAt = Date.now();
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
    toldAt = Date.now();
    setState({ stop: null });
  } catch (error) {
    const sentence = error instanceof http.HttpError ? error.message : "";
    if (sentence === "") toast("danger", i18next.t("stop.releaseFailed"));
    else toast("danger", sentence, "en");
  }
}
