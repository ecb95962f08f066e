/**
 * The few plain HTTP requests of the page: login, health, stop and release. They do not need the ACP connection;
 * above all Stop must work without it. Nothing here touches the state of the page.
 */
import { parseHealth, parseMe, type Health, type Me } from "../wire/bridge";
import { asString, isRecord } from "../wire/fields";
import { parseStop, type Stop } from "../wire/telemetry";

/** A request that did not succeed. `status` is 0 when nothing answered; the message is for people, empty where there is none. */
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

/** An answer that cannot be read counts as none. */
function required<T>(parsed: T | null): T {
  if (parsed === null) throw new HttpError(0, "");
  return parsed;
}

export async function login(token: string): Promise<Me> {
  return required(parseMe((await call("POST", "/api/login", { token })).body));
}

export async function logout(): Promise<void> {
  await call("POST", "/api/logout", {});
}

export interface WhoAmI {
  me: Me;
  /** Time of a whole round trip in ms. */
  latencyMs: number;
  /** The server's clock minus this machine's, in ms; null when the answer has no date. */
  clockOffsetMs: number | null;
}

export async function whoAmI(): Promise<WhoAmI> {
  const sentAt = performance.now();
  const { body, response } = await call("GET", "/api/me");
  const latencyMs = performance.now() - sentAt;
  const date = Date.parse(response.headers.get("Date") ?? "");
  // The header has whole seconds: half a second more is right on average.
  const offset = Number.isNaN(date) ? null : date + 500 - Date.now();
  return { me: required(parseMe(body)), latencyMs, clockOffsetMs: offset };
}

export async function health(): Promise<Health> {
  return required(parseHealth((await call("GET", "/api/health")).body));
}

export async function stopRobot(): Promise<Stop | null> {
  const { body } = await call("POST", "/api/stop", {});
  return isRecord(body) ? parseStop(body["stopped"]) : null;
}

export async function releaseRobot(): Promise<void> {
  await call("POST", "/api/release", {});
}
