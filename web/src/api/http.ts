/**
 * The few plain HTTP requests of the page: login, health, stop and release. They do not need the ACP connection;
 * above all Stop must work without it. Nothing here touches the state of the page.
 */
import { asNumber, asString, isRecord } from "../wire/meta";
import { parseStop, type Stop } from "../wire/telemetry";

export const ROLES = ["viewer", "visitor", "operator", "supervisor"] as const;
export type Role = (typeof ROLES)[number];

export interface Me {
  name: string;
  role: Role;
  robot: string;
}

export interface Part {
  up: boolean;
  detail: string;
}

export interface Health {
  agent: Part;
  robot: Part;
  robotName: string | null;
}

/** A request that did not succeed. `status` is 0 when nothing answered; the message is for people. */
export class HttpError extends Error {
  constructor(
    readonly status: number,
    message: string,
  ) {
    super(message);
  }
}

interface Answer {
  body: unknown;
  response: Response;
}

async function call(method: "GET" | "POST", path: string, body?: unknown, seconds = 6): Promise<Answer> {
  let response: Response;
  try {
    response = await fetch(path, {
      method,
      credentials: "same-origin",
      cache: "no-store",
      signal: AbortSignal.timeout(seconds * 1000),
      ...(body === undefined
        ? {}
        : { headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) }),
    });
  } catch {
    throw new HttpError(0, "");
  }
  const parsed: unknown = await response.json().catch(() => null);
  if (!response.ok) {
    const sentence = isRecord(parsed) ? asString(parsed["error"]) : null;
    throw new HttpError(response.status, sentence ?? "");
  }
  return { body: parsed, response };
}

function parseMe(body: unknown): Me {
  const role = isRecord(body) ? ROLES.find((known) => known === body["role"]) : undefined;
  if (!isRecord(body) || role === undefined) throw new HttpError(0, "");
  return { name: asString(body["name"]) ?? "", role, robot: asString(body["robot"]) ?? "" };
}

export async function login(token: string): Promise<Me> {
  return parseMe((await call("POST", "/api/login", { token })).body);
}

export async function logout(): Promise<void> {
  await call("POST", "/api/logout", {});
}

export interface WhoAmI {
  me: Me;
  /** Time of a whole round trip in ms. */
  latencyMs: number;
  /** What has to be added to this machine's clock to get the server's, in ms; null when it does not tell. */
  clockOffsetMs: number | null;
}

export async function whoAmI(): Promise<WhoAmI> {
  const begun = performance.now();
  const { body, response } = await call("GET", "/api/me");
  const latencyMs = performance.now() - begun;
  const date = Date.parse(response.headers.get("Date") ?? "");
  // The header has whole seconds: half a second more is right on average.
  const offset = Number.isNaN(date) ? null : date + 500 - Date.now();
  return { me: parseMe(body), latencyMs, clockOffsetMs: offset };
}

export async function health(): Promise<Health> {
  const { body } = await call("GET", "/api/health");
  if (!isRecord(body)) throw new HttpError(0, "");
  return {
    agent: parsePart(body["agent"]),
    robot: parsePart(body["robot"]),
    robotName: asString(body["robot_name"]),
  };
}

function parsePart(value: unknown): Part {
  if (!isRecord(value)) return { up: false, detail: "" };
  return {
    up: value["up"] === true,
    detail: asString(value["detail"]) ?? String(asNumber(value["detail"]) ?? ""),
  };
}

export async function stopRobot(): Promise<Stop | null> {
  const { body } = await call("POST", "/api/stop", {});
  return isRecord(body) ? parseStop(body["stopped"]) : null;
}

export async function releaseRobot(): Promise<void> {
  await call("POST", "/api/release", {});
}
