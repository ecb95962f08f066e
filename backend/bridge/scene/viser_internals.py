"""All that this project knows of viser's inside, and all that it changes there. No other file relies on either.

viser's public API draws the scene. What the API does not offer is done here, and rests on the inside of one version;
`pyproject.toml` pins its minor version. `tests/bridge/test_viser_internals.py` has a test for each item, which fails
when viser changes what the item rests on:

| item | reason |
|---|---|
| `wake_pages_in_own_thread` | viser sets an asyncio event from the thread that draws, which asyncio forbids |
| `silenced` | viser prints its start and its end to standard output |
| `decode`, `camera_frame`, `click_frame` | the proxy answers a page itself: nothing of a browser may reach viser |
| `_STAY_CONNECTED` | viser's page connects again only while it has the focus, which an embedded page rarely has |
| `_BRING_TICKET`, `_FROM_OUTER_PAGE`, `_START_WORKERS` | a page in a sandbox lacks cookies and more |
| `_HIDE_PANEL`, `_SHOW_DISCONNECTION` | viser's panel does not belong to the picture, but knows the connection |
| `_REPORT_CAMERA_MOVES` | viser does not report whether a person or the server moved a page's camera |
| `_PACE_FRAMES` | viser draws as often as it can, which starves a computer without a graphics chip |

This file must never pass on what a browser sent. It does not import viser, whose import takes a second.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import msgspec
import rich
import zstandard  # a dependency of viser, which compresses with it

from backend import wire

if TYPE_CHECKING:
    import viser

# --- The server in this process ---


class _OwnThreadEvent(asyncio.Event):
    """An event that only its own event loop can set."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__()
        self._own_loop = loop

    def set(self) -> None:
        """Wake the waiting tasks; does nothing when called outside the event's own loop."""
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:
            return
        if loop is self._own_loop:
            super().set()


def wake_pages_in_own_thread(server: viser.ViserServer) -> None:
    """Make drawing from another thread safe. To be called before the first page connects to `server`.

    For each change viser sets the event `message_event` twice: at once, in the thread that draws, and a moment later in
    the thread of its event loop. The first call is not thread-safe: it fails now and then while many pages wait, and
    the rest of the drawing is lost. The second call suffices, so the first is made to do nothing.
    """
    buffer = server._websock_server.get_message_buffer()
    buffer.message_event = _OwnThreadEvent(buffer.event_loop)


@contextmanager
def silenced() -> Iterator[None]:
    """Suppress what viser prints through `rich` at its start and its end, even with `verbose=False`."""
    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before


# --- The WebSocket protocol between page and server ---
#
# A page sends one msgpack map a frame. The server sends windows of messages: the sizes of the unpacked and of the
# packed window (8 bytes each, little-endian), then the window as msgpack in zstandard. Page and server check by the
# subprotocol that they are of the same version.

SUBPROTOCOL_PREFIX = "viser-v"
MAX_FRAME_BYTES = 4096
"""Longer frames of a page are ignored; a report of its camera has about 400 bytes."""

Triple = tuple[float, float, float]


class _CameraMessage(msgspec.Struct, frozen=True, tag_field="type", tag="ViewerCameraMessage"):
    position: Triple
    look_at: Triple
    image_width: int
    image_height: int


class _PointerMessage(msgspec.Struct, frozen=True, tag_field="type", tag="ScenePointerMessage"):
    event_type: str
    ray_origin: Triple | None
    ray_direction: Triple | None


class PageCamera(msgspec.Struct, frozen=True):
    """Where a page's camera stands and what it looks at, in m of the map frame; `aspect` is width to height."""

    position: Triple
    look_at: Triple
    aspect: float


class Click(msgspec.Struct, frozen=True):
    """A click into the scene: the ray from the camera through the pixel, in the map frame."""

    origin: Triple
    direction: Triple


_compressor = zstandard.ZstdCompressor(level=1)  # not thread-safe: for the event loop's thread alone
_decoder: msgspec.msgpack.Decoder[_CameraMessage | _PointerMessage] = msgspec.msgpack.Decoder(
    _CameraMessage | _PointerMessage
)


def decode(frame: bytes) -> PageCamera | Click | None:
    """What a page reports; None for any other or malformed frame."""
    if len(frame) > MAX_FRAME_BYTES:
        return None
    try:
        message = _decoder.decode(frame)
    except wire.UNREADABLE:
        return None
    if isinstance(message, _CameraMessage):
        if message.image_width <= 0 or message.image_height <= 0:
            return None
        if not _are_finite(*message.position, *message.look_at):
            return None
        return PageCamera(message.position, message.look_at, message.image_width / message.image_height)
    origin, direction = message.ray_origin, message.ray_direction
    if message.event_type != "click" or origin is None or direction is None:
        return None
    return Click(origin, direction) if _are_finite(*origin, *direction) else None


def camera_frame(position: Triple, look_at: Triple) -> bytes:
    """The frame that puts a page's camera at `position` and turns it to `look_at`, both in m of the map frame."""
    return _window(
        [
            {"type": "SetCameraPositionMessage", "position": position, "initial": False},
            {"type": "SetCameraLookAtMessage", "look_at": look_at, "initial": False},
        ]
    )


def click_frame(wanted: bool) -> bytes:
    """The frame that makes a page report clicks, or stop doing so."""
    modifiers = [None] if wanted else []  # None: a click without Shift, Ctrl or Alt
    return _window(
        [{"type": "ScenePointerEnableMessage", "event_type": "click", "modifiers": modifiers, "owner": "bridge"}]
    )


def _window(messages: Iterable[dict[str, Any]]) -> bytes:
    packed = msgspec.msgpack.encode(
        {"messages": list(messages), "timestampSec": time.perf_counter(), "binaryBufferLengths": []}
    )
    compressed = _compressor.compress(packed)
    return len(packed).to_bytes(8, "little") + len(compressed).to_bytes(8, "little") + compressed


def _are_finite(*values: float) -> bool:
    return all(map(math.isfinite, values))


# --- The page ---

CONTENT_SECURITY_POLICY = "; ".join(
    [
        # viser's page is foreign code: without an origin it reaches neither the page around it nor its login.
        "sandbox allow-scripts",
        "default-src 'none'",
        # The page is one file that unpacks itself: inline scripts, workers from blobs, a decoder in WebAssembly.
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

_STAY_CONNECTED = """<script>
  // viser's page connects again only while `document.hasFocus()`, which is rarely true in an embedded page.
  document.hasFocus = () => true;
</script>
"""

_HIDE_PANEL = """<style>
  /* The scene is a picture beside the conversation: viser's panel and notifications are not part of it. */
  .mantine-Paper-root, .mantine-Notifications-root, [data-portal] { display: none !important; }
  html, body { overflow: hidden; background: rgb(206 212 221); }
</style>
"""

_FROM_OUTER_PAGE = """<script>
  // The page around the scene says which language it has, and whether the scene is covered: a sandboxed page cannot see
  // it. Without a page around it, the browser's language counts.
  const outerPage = { lang: navigator.language, covered: false };
  const setLanguage = () => {
    document.documentElement.lang = /^es\\b/.test(outerPage.lang) ? "es" : "en";
  };
  setLanguage();
  addEventListener("message", ({ source, data }) => {
    if (source !== parent || data?.type !== "scene-frame") return;
    outerPage.lang = String(data.lang || navigator.language);
    outerPage.covered = data.covered === true;
    setLanguage();
  });
</script>
"""

TICKET = "the-ticket-of-this-viewer"
"""Stands in the page where the ticket of a viewer belongs."""

_START_WORKERS = """<script>
  // In a sandbox, the browser starts no module from a blob, and reports that too late for viser. Reported at once, it
  // makes viser start its workers from a data address instead, which works.
  window.Worker = class extends window.Worker {
    constructor(address, options) {
      if (options?.type === "module" && /^blob:/.test(address)) throw new Error("no module from a blob here");
      super(address, options);
    }
  };
</script>
"""

_BRING_TICKET = """<script>
  // A sandboxed page has no cookies: a ticket opens its WebSocket and reports that a person has moved the camera.
  // viser's page reads the address of its WebSocket from the query.
  const sceneTicket = "the-ticket-of-this-viewer";
  const sceneSocket = location.href.split("?")[0].replace(/^http/, "ws").replace(/[/]$/, "");
  history.replaceState(null, "", "?websocket=" + encodeURIComponent(`${sceneSocket}?ticket=${sceneTicket}`));
</script>
"""

_SHOW_DISCONNECTION = """<style>
  /* Nobody may take an old picture for a live one. The hidden panel shows this check mark while it is connected. */
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

_REPORT_CAMERA_MOVES = """<script>
  // The page of one viewer reports when a person moves its camera. The positions that viser reports do not show that
  // reliably: a camera that follows the robot is set so often that a slow page never shows what the person did.
  if (location.pathname !== "/scene/") {
    const REPORT_EVERY = 300; // ms
    const DRAG_DISTANCE = 4; // pixels; a shorter drag is a click
    let pressedAt = null, reportedAt = -Infinity;
    const report = () => {
      if (performance.now() - reportedAt < REPORT_EVERY) return;
      reportedAt = performance.now();
      fetch(`moved?ticket=${sceneTicket}`, { method: "POST", mode: "no-cors" }).catch(() => undefined);
    };
    const listen = (kind, handler) => addEventListener(kind, handler, { capture: true, passive: true });
    listen("pointerdown", (event) => { pressedAt = event; });
    listen("pointerup", () => { pressedAt = null; });
    listen("pointercancel", () => { pressedAt = null; });
    listen("pointermove", (event) => {
      if (!pressedAt) return;
      const dragged = Math.hypot(event.clientX - pressedAt.clientX, event.clientY - pressedAt.clientY);
      if (dragged > DRAG_DISTANCE) report();
    });
    listen("wheel", report);
    listen("keydown", (event) => { if (/^(Key[WASDQE]|Arrow.*)$/.test(event.code)) report(); });
  }
</script>
"""

_PACE_FRAMES = """<script>
  // Without a graphics chip, drawing takes the processor away from the page around the map: from Stop, from a question.
  // This script stands between viser's page and its animation frames. It never draws itself.
  // - After a slow frame it waits as long as the frame took, 1 s at most, unless a person moves the camera.
  // - While frames are slow, it starts none before the last is finished. Only a WebGL fence shows when a frame is
  //   finished: the script that draws it ends long before.
  // - While the map is covered, as on a phone that shows the conversation, it starts no frame. The browser does not
  //   stop them in that case.
  // - Quick frames of a visible map pass unchanged.
  (() => {
    const SLOW_FRAME = 50, LONGEST_REST = 1000, AFTER_INPUT = 500, COVERED_CHECK = 200, FENCE_CHECK = 10; // ms
    const requestFrame = window.requestAnimationFrame.bind(window);
    const { getContext } = HTMLCanvasElement.prototype;
    const callbacks = new Map();
    let gl = null, fence = null, frameStart = 0, frameTime = 0, restUntil = 0, lastInput = -Infinity;
    let lastId = 0, isRequested = false, isDrawing = false;

    const drawsInSoftware = () => {
      const probe = getContext.call(document.createElement("canvas"), "webgl2");
      const info = probe?.getExtension("WEBGL_debug_renderer_info");
      const name = probe?.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : probe.RENDERER) ?? "";
      probe?.getExtension("WEBGL_lose_context")?.loseContext();
      return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
    };
    HTMLCanvasElement.prototype.getContext = function (kind, options) {
      if (kind !== "webgl2") return getContext.call(this, kind, options);
      // Without a graphics chip, antialiasing costs as much as all the rest of a frame.
      gl = getContext.call(this, kind, drawsInSoftware() ? { ...options, antialias: false } : options);
      return gl;
    };
    const isCovered = () => outerPage.covered;
    const deleteFence = () => {
      gl.deleteSync(fence);
      fence = null;
    };
    const timeToWait = (now) => { // ms; 0 when a frame may be drawn now
      if (isCovered()) {
        if (fence) deleteFence(); // its frame cannot be timed any more
        return COVERED_CHECK;
      }
      const isMovedByHand = now - lastInput < AFTER_INPUT;
      if (fence && gl.getSyncParameter(fence, gl.SYNC_STATUS) === gl.UNSIGNALED) {
        return isMovedByHand || Math.max(frameTime, now - frameStart) < SLOW_FRAME ? 0 : FENCE_CHECK;
      }
      if (fence) {
        deleteFence();
        frameTime = now - frameStart;
        restUntil = now + Math.min(frameTime, LONGEST_REST);
      }
      return isMovedByHand || frameTime < SLOW_FRAME ? 0 : restUntil - now;
    };
    const schedule = () => { isRequested = true; requestFrame(onFrame); };
    const onFrame = (time) => {
      const now = performance.now(), wait = timeToWait(now);
      if (wait > 0) return setTimeout(schedule, wait);
      isRequested = false;
      isDrawing = true;
      for (const id of [...callbacks.keys()]) { // a callback may cancel another one, which is then undefined
        const callback = callbacks.get(id);
        callbacks.delete(id);
        try { callback?.(time); } catch (error) { reportError(error); }
      }
      isDrawing = false;
      if (fence || !gl) return;
      frameStart = now;
      fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
      gl.flush();
    };
    window.requestAnimationFrame = (callback) => {
      callbacks.set(++lastId, callback);
      if (!isRequested && !isDrawing) frameStart = performance.now(); // time without anything to draw is not slowness
      if (!isRequested) schedule();
      return lastId;
    };
    window.cancelAnimationFrame = (id) => { callbacks.delete(id); };

    const listen = (kind, handler) => addEventListener(kind, handler, { capture: true, passive: true });
    listen("visibilitychange", () => { frameStart = performance.now(); }); // nor is time in a hidden tab
    const onInput = (event) => { if (event.type !== "pointermove" || event.buttons) lastInput = performance.now(); };
    for (const kind of ["pointerdown", "pointermove", "wheel", "keydown"]) listen(kind, onInput);
  })();
</script>
"""

_HEAD = "".join(
    [
        _STAY_CONNECTED,
        _FROM_OUTER_PAGE,
        _START_WORKERS,
        _BRING_TICKET,
        _SHOW_DISCONNECTION,
        _REPORT_CAMERA_MOVES,
        _HIDE_PANEL,
        _PACE_FRAMES,
    ]
)


def patched_page(page: str) -> str:
    """viser's page with the scripts and styles of this file. Raises `ValueError` for a page without a `<head>`."""
    if "<head>" not in page:
        raise ValueError("viser's page has no <head>")
    return page.replace("<head>", "<head>\n" + _HEAD, 1)
