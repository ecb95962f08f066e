/** The session in the address bar and in this browser's memory; the token of a login link leaves the address at once. */

const LAST = "robot-acp/last-session";

/** The login token of `#token=…`; it is removed from the address bar and from the history. */
export function takeToken(): string | null {
  const token = new URLSearchParams(window.location.hash.slice(1)).get("token");
  if (token !== null)
    window.history.replaceState(null, "", window.location.pathname + window.location.search);
  return token;
}

/** The session that the page should open: of the address, else the last one that was open here. */
export function sessionOfAddress(): string | null {
  return sessionOfHash() ?? remembered();
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

function remembered(): string | null {
  try {
    return window.localStorage.getItem(LAST);
  } catch {
    return null; // a browser may forbid it; then the newest session is opened
  }
}

export function rememberSession(sessionId: string): void {
  const hash = `#/s/${encodeURIComponent(sessionId)}`;
  if (window.location.hash !== hash) {
    // The first one replaces the bare address, so that Back does not lead to a page without a session.
    const method = sessionOfHash() === null ? "replaceState" : "pushState";
    window.history[method](null, "", window.location.pathname + window.location.search + hash);
  }
  try {
    window.localStorage.setItem(LAST, sessionId);
  } catch {
    // See above.
  }
}
