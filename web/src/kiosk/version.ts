/** Checks whether the server has another build of this page than the one that runs. Called while nobody is at the kiosk. */

const SCRIPT = /<script[^>]+type="module"[^>]+src="([^"]+)"/;

/** False also when the server does not answer: then there is nothing to load. */
export async function isOutdated(): Promise<boolean> {
  const running = document.querySelector<HTMLScriptElement>("script[type=module][src]");
  if (running === null) return false;
  try {
    const answer = await fetch(window.location.pathname, { cache: "no-store", credentials: "same-origin" });
    if (!answer.ok) return false;
    const offered = SCRIPT.exec(await answer.text())?.[1];
    return offered !== undefined && offered !== running.getAttribute("src");
  } catch {
    return false;
  }
}
