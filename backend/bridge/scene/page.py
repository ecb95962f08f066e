"""viser's page as the bridge serves it: with a little more in its head, and with headers of its own."""

from __future__ import annotations

from backend.bridge.scene.pacing import PACING

POLICY = "; ".join(
    [
        "default-src 'none'",
        # One file that unpacks itself: inline scripts, workers from blobs, and a decoder in WebAssembly.
        "script-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:",
        "worker-src 'self' blob: data:",
        "style-src 'self' 'unsafe-inline'",
        "img-src 'self' data: blob:",
        "font-src 'self' data:",
        "connect-src 'self' blob: data:",
        "frame-ancestors 'self'",
        "base-uri 'none'",
        "form-action 'none'",
    ]
)

_HEAD = """<head>
<script>
  // viser reconnects only in a page that has the focus, which an embedded one rarely has.
  document.hasFocus = () => true;
  // The notice speaks the language of the page around the map, also when that changes.
  const around = parent === window ? null : parent.document.documentElement;
  const speak = () => {
    document.documentElement.lang = /^es\\b/.test(around?.lang || navigator.language) ? "es" : "en";
  };
  speak();
  if (around) new MutationObserver(speak).observe(around, { attributeFilter: ["lang"] });
  // The page of one viewer tells when its viewer moves the camera. Where it stands alone does not tell: what follows
  // the robot sets it so often that a slow page never shows what a hand did in between.
  if (location.pathname !== "/scene/") {
    let from = null, told = -Infinity;
    const moved = () => {
      if (performance.now() - told < 300) return;
      told = performance.now();
      fetch("moved", { method: "POST" }).catch(() => undefined);
    };
    const listen = (kind, then) => addEventListener(kind, then, { capture: true, passive: true });
    listen("pointerdown", (event) => { from = event; });
    listen("pointerup", () => { from = null; });
    listen("pointercancel", () => { from = null; });
    listen("pointermove", (event) => {
      if (from && Math.hypot(event.clientX - from.clientX, event.clientY - from.clientY) > 4) moved();
    });
    listen("wheel", moved);
    listen("keydown", (event) => { if (/^(Key[WASDQE]|Arrow.*)$/.test(event.code)) moved(); });
  }
</script>
<style>
  /* The scene is a picture beside the conversation: viser's panel and its notices have no place in it. */
  .mantine-Paper-root, .mantine-Notifications-root, [data-portal] { display: none !important; }
  html, body { overflow: hidden; background: rgb(206 212 221); }
  /* A picture that stands still must not pass for a live one. The check mark is the hidden panel's. */
  body:not(:has(.tabler-icon-cloud-check))::after {
    content: "The map is not connected. Trying again …";
    position: fixed; inset: auto 0 12px; z-index: 100; margin: auto; width: fit-content;
    padding: 8px 12px; border-radius: 8px; background: rgb(31 41 55); color: white;
    font: 14px/1.4 system-ui, sans-serif; opacity: 0; animation: appear 0s 2s forwards;
  }
  :lang(es) > body:not(:has(.tabler-icon-cloud-check))::after {
    content: "El mapa no está conectado. Intentándolo …";
  }
  @keyframes appear { to { opacity: 1; } }
</style>
"""


def patched(page: str) -> str:
    """viser's page, fit to be embedded. Raises `ValueError` when it has no head."""
    if "<head>" not in page:
        raise ValueError("viser's page has no <head>")
    return page.replace("<head>", _HEAD + PACING, 1)
