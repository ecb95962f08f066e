/**
 * The few plain HTTP requests of the page: login, health, the map's probe, the list of logins, stop and release. They do not need the ACP
 * connection; above all Stop must work without it. Each has a time limit, and only an answer of the bridge's own form
 * counts: a proxy or a login portal answers everything with a page and status 200. Nothing here touches the state of the
 * page.
 */
import { parseHealth, parseMe, type Health, type Me, type Role } from "../wire/bridge";
import { asString, isRecord } from "../wire/fields";
import { parseLogins, parseNewLogin, type IssuedLogin, type NewLogin } from "../wire/logins";
import { parseStopAnswer, type Stop } from "../wire/telemetry";

/** A request that did not succeed. `status` is 0 when the bridge did not answer; the message is for people, empty where there is none. */
export class HttpError extends Error {
  constructor(
    readonly status: number,
    message: string,
  ) {
    super(message);
  }
}

/** Something else answered in place of the bridge, so what was asked for has not happened. */
export class ForeignAnswer extends HttpError {
  constructor() {
    super(0, "");
  }
}

/** The request was given up, because its answer is not wanted any more. */
export class Interrupted extends Error {}

type Method = "GET" | "POST" | "DELETE";

interface Answer {
  /** Null for an answer that is not JSON. */
  body: unknown;
  response: Response;
}

interface Options {
  body?: unknown;
  /** Aborting it gives the request up. */
  signal?: AbortSignal | undefined;
  priority?: RequestPriority;
}

const LIMIT_MS = 6000;

/** Each gives up one request that only reads. */
const readers = new Set<() => void>();

/** Sends one request and reads its answer with `read`. Throws `Interrupted`, and `HttpError` where nothing answers. */
async function send<T>(
  method: Method,
  path: string,
  options: Options,
  read: (response: Response) => Promise<T>,
): Promise<T> {
  const { body, signal, priority } = options;
  const controller = new AbortController();
  let interrupted = signal?.aborted === true;
  const interrupt = (): void => {
    interrupted = true;
    controller.abort();
  };
  if (interrupted) controller.abort();
  signal?.addEventListener("abort", interrupt);
  const timer = setTimeout(() => controller.abort(), LIMIT_MS);
  if (method === "GET") readers.add(interrupt);
  try {
    const response = await fetch(path, {
      method,
      credentials: "same-origin",
      cache: "no-store",
      signal: controller.signal,
      ...(priority === undefined ? {} : { priority }),
      ...(body === undefined
        ? {}
        : { headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) }),
    });
    return await read(response);
  } catch {
    throw interrupted ? new Interrupted() : new HttpError(0, "");
  } finally {
    clearTimeout(timer);
    readers.delete(interrupt);
    signal?.removeEventListener("abort", interrupt);
  }
}

async function call(method: Method, path: string, options: Options = {}): Promise<Answer> {
  const { text, response } = await send(method, path, options, async (answer) => ({
    text: await answer.text(),
    response: answer,
  }));
  const body = parseJson(text);
  if (!response.ok) {
    // Only the bridge itself may end a login.
    if (response.status === 401 && !isRecord(body)) throw new ForeignAnswer();
    throw new HttpError(response.status, errorOf(body));
  }
  return { body, response };
}

function parseJson(text: string): unknown {
  try {
    return JSON.parse(text);
  } catch {
    return null;
  }
}

/** The bridge's sentence about what went wrong; empty where there is none. */
function errorOf(body: unknown): string {
  return (isRecord(body) ? asString(body["error"]) : null) ?? "";
}

function required<T>(parsed: T | null): T {
  if (parsed === null) throw new ForeignAnswer();
  return parsed;
}

export async function login(token: string): Promise<Me> {
  return required(parseMe((await call("POST", "/api/login", { body: { token } })).body));
}

export async function logout(): Promise<void> {
  await call("POST", "/api/logout", { body: {} });
}

export interface WhoAmI {
  me: Me;
  /** Time of a whole round trip in ms. */
  latencyMs: number;
  /** The server's clock minus this machine's, in ms; null when the answer has no date. */
  clockOffsetMs: number | null;
}

export async function whoAmI(signal?: AbortSignal): Promise<WhoAmI> {
  const sentAt = performance.now();
  const { body, response } = await call("GET", "/api/me", { signal });
  const latencyMs = performance.now() - sentAt;
  const date = Date.parse(response.headers.get("Date") ?? "");
  // The header has whole seconds: half a second more is right on average.
  const offset = Number.isNaN(date) ? null : date + 500 - Date.now();
  return { me: required(parseMe(body)), latencyMs, clockOffsetMs: offset };
}

export async function health(signal?: AbortSignal): Promise<Health> {
  return required(parseHealth((await call("GET", "/api/health", { signal })).body));
}

/** Whether the bridge serves the map's page at `address`. Throws `Interrupted`. */
export async function servesScene(address: string, signal: AbortSignal): Promise<boolean> {
  try {
    return await send("GET", address, { signal }, async (response) => {
      await response.body?.cancel().catch(() => undefined);
      return response.ok && (response.headers.get("Content-Type") ?? "").startsWith("text/html");
    });
  } catch (error) {
    if (error instanceof Interrupted) throw error;
    return false;
  }
}

/**
 * Stops the robot. Requests that only read are given up first: a browser sends six at a time to one server over HTTP/1.1,
 * and Stop must not wait for any of them. Throws `ForeignAnswer` where the answer does not say that the robot is stopped.
 */
export async function stopRobot(): Promise<Stop> {
  for (const interrupt of readers) interrupt();
  const { body, response } = await call("POST", "/api/stop", { body: {}, priority: "high" });
  const stop = parseStopAnswer(body);
  if (stop === null && errorOf(body) !== "") throw new HttpError(response.status, errorOf(body));
  return required(stop);
}

/** Releases the stop. Throws `ForeignAnswer` where the answer does not say so. */
export async function releaseRobot(): Promise<void> {
  const { body } = await call("POST", "/api/release", { body: {} });
  if (!isRecord(body) || body["stopped"] !== null) throw new ForeignAnswer();
}

/** The logins that were issued. Only supervisors may ask. */
export async function listLogins(): Promise<IssuedLogin[]> {
  return required(parseLogins((await call("GET", "/api/tokens")).body));
}

/** Makes a login; `expires` is a time such as 7d, or a date. `samePerson`: it is for the one who has this name already. */
export async function createLogin(
  name: string,
  role: Role,
  expires: string,
  samePerson: boolean,
): Promise<NewLogin> {
  const body = { name, role, expires, same_person: samePerson };
  return required(parseNewLogin((await call("POST", "/api/tokens", { body })).body));
}

/** Ends a login. One's own is ended only where `own` says so. */
export async function revokeLogin(id: string, own: boolean): Promise<void> {
  await call("DELETE", `/api/tokens/${encodeURIComponent(id)}${own ? "?own=true" : ""}`);
}
