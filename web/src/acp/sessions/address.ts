/** The session in the address bar and in this browser's storage; the token of a login link leaves the address at once. */
import { readStored, removeStored, STORAGE, writeStored } from "../../browser-storage";

/** The login token of `#token=…`; it is removed from the address bar and from the history. */
export function takeToken(): string | null {
  const token = new URLSearchParams(window.location.hash.slice(1)).get("token");
  if (token !== null)
    window.history.replaceState(null, "", window.location.pathname + window.location.search);
  return token;
}

/** The session that the page should open: that of the address, else the last one that was open in this browser. */
export function sessionToOpen(): string | null {
  return sessionOfHash() ?? readStored(STORAGE.lastSession);
}

export function sessionOfHash(): string | null {
  const match = /^#\/s\/([^/]+)$/.exec(window.location.hash);
  if (match?.[1] === undefined) return null;
  try {
    return decodeURIComponent(match[1]);
  } catch {
    return null;
  }
}

/** The session does not exist any more: neither the address nor the next visit leads to it. */
export function forgetRemembered(sessionId: string): void {
  if (sessionOfHash() === sessionId)
    window.history.replaceState(null, "", window.location.pathname + window.location.search);
  if (readStored(STORAGE.lastSession) === sessionId) removeStored(STORAGE.lastSession);
}

export function rememberSession(sessionId: string): void {
  const hash = `#/s/${encodeURIComponent(sessionId)}`;
  if (window.location.hash !== hash) {
    // The first one replaces the bare address, so that Back does not lead to a page without a session.
    const method = sessionOfHash() === null ? "replaceState" : "pushState";
    window.history[method](null, "", window.location.pathname + window.location.search + hash);
  }
  writeStored(STORAGE.lastSession, sessionId);
}
