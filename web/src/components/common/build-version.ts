/** Which build of this page the server has, and loading the page again: only where the server has a page to load. */

const SCRIPT = /<script[^>]+type="module"[^>]+src="([^"]+)"/;
const LIMIT_MS = 5000;

/** The page's own address as the server answers it now; null when it does not. */
async function servedPage(): Promise<string | null> {
  try {
    const answer = await fetch(window.location.pathname, {
      cache: "no-store",
      credentials: "same-origin",
      signal: AbortSignal.timeout(LIMIT_MS),
    });
    return answer.ok ? await answer.text() : null;
  } catch {
    return null;
  }
}

/** Whether the server has another build than the one that runs. False also when the server does not answer: then there is nothing to load. */
export async function isOutdated(): Promise<boolean> {
  const running = document.querySelector<HTMLScriptElement>("script[type=module][src]");
  if (running === null) return false;
  const offered = SCRIPT.exec((await servedPage()) ?? "")?.[1];
  return offered !== undefined && offered !== running.getAttribute("src");
}

/** Loads the page again; false where the server does not answer, because the browser would show a page without Stop then. */
export async function reloadPage(): Promise<boolean> {
  const served = SCRIPT.test((await servedPage()) ?? "");
  if (served) window.location.reload();
  return served;
}
