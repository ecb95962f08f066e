"""`/scene/` and `WS /scene`: viser behind the bridge's login, on the bridge's own port.

viser itself listens on loopback and asks nobody who they are. Of what a viewer sends, only the camera is passed
on: anything else could change what others see, and one of viser's messages opens a tunnel to the internet.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging

import httpx
import msgspec
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.types import Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.typing import Subprotocol

from backend.bridge.closing import LEFT, POLICY_VIOLATION, TRY_AGAIN_LATER, End, close
from backend.bridge.login import Gate, Login, admit_websocket
from backend.bridge.race import first_of
from backend.bridge.scene import page
from backend.bridge.scene.scene import Scene, SceneDownError

CAMERA_MESSAGE = "ViewerCameraMessage"
_START_SECONDS = 20.0
_SEND_SECONDS = 15.0
_NOT_READY = End(TRY_AGAIN_LATER, "The scene is not ready.")

log = logging.getLogger(__name__)


class _Tagged(msgspec.Struct):
    type: str


_type_of = msgspec.msgpack.Decoder(_Tagged)


class ScenePage:
    """The page. It is fetched from viser once and kept."""

    def __init__(self, gate: Gate, scene: Scene) -> None:
        self._gate = gate
        self._scene = scene
        self._page: str | None = None
        self._etag = ""

    async def answer(self, request: Request) -> Response:
        """`GET /scene/`. Raises `LoginError`."""
        self._gate.login(request)
        try:
            text = self._page or await self._fetch()
        except SceneDownError as error:
            return JSONResponse({"error": str(error)}, status_code=503)
        headers = {
            "Content-Security-Policy": page.POLICY,
            "Cache-Control": "private, no-cache",
            "ETag": self._etag,
        }
        if request.headers.get("if-none-match") == self._etag:
            return Response(status_code=304, headers=headers)
        return HTMLResponse(text, headers=headers)

    async def _fetch(self) -> str:
        try:
            async with asyncio.timeout(_START_SECONDS), httpx.AsyncClient(trust_env=False) as client:
                answer = await client.get(f"http://127.0.0.1:{await self._scene.port()}/")
                answer.raise_for_status()
        except (httpx.HTTPError, TimeoutError):
            raise SceneDownError("The scene is not ready. Try again in a moment.") from None
        self._page = page.patched(answer.text)
        self._etag = f'"{hashlib.sha256(self._page.encode()).hexdigest()[:32]}"'
        return self._page


async def with_slash(_: Request) -> Response:
    """`GET /scene`: the page finds its WebSocket by its own address, which has to end in a slash."""
    return RedirectResponse("/scene/", status_code=308)


class SceneSocket:
    """The WebSocket between a viewer's page and viser."""

    def __init__(self, gate: Gate, scene: Scene) -> None:
        self._gate = gate
        self._scene = scene

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Relay one viewer, until either side is gone."""
        websocket = WebSocket(scope, receive, send)
        login = await admit_websocket(self._gate, websocket)
        if login is None:
            return
        await close(websocket, await self._serve(websocket, login))

    async def _serve(self, websocket: WebSocket, login: Login) -> End:
        offered = [Subprotocol(name) for name in websocket.scope["subprotocols"] if name.startswith("viser-")]
        try:
            async with asyncio.timeout(_START_SECONDS):
                port = await self._scene.port()
            async with connect(
                f"ws://127.0.0.1:{port}/",
                subprotocols=offered or None,
                compression=None,
                proxy=None,
                max_size=None,
                ping_interval=None,
            ) as viser:
                await websocket.accept(subprotocol=viser.subprotocol)
                self._scene.viewer_came()
                try:
                    return await first_of(
                        _to_viser(websocket, viser), _to_viewer(viser, websocket), self._gate.until_ended(login)
                    )
                finally:
                    self._scene.viewer_left()
        except (SceneDownError, OSError, WebSocketException, TimeoutError) as error:
            log.warning("scene: viser cannot be reached: %s", error)
            return _NOT_READY


async def _to_viser(websocket: WebSocket, viser: ClientConnection) -> End:
    while True:
        message = await websocket.receive()
        if message["type"] == "websocket.disconnect":
            return LEFT
        frame = message.get("bytes")
        if frame is not None and _is_camera(frame):
            try:
                await viser.send(frame)
            except ConnectionClosed:
                return _NOT_READY


async def _to_viewer(viser: ClientConnection, websocket: WebSocket) -> End:
    try:
        async for frame in viser:
            async with asyncio.timeout(_SEND_SECONDS):
                await websocket.send_bytes(frame if isinstance(frame, bytes) else frame.encode())
    except TimeoutError:
        return End(POLICY_VIOLATION, "The page does not read.")
    except WebSocketDisconnect:
        return LEFT
    except ConnectionClosed:
        pass
    return _NOT_READY


def _is_camera(frame: bytes) -> bool:
    try:
        return _type_of.decode(frame).type == CAMERA_MESSAGE
    except (msgspec.ValidationError, msgspec.DecodeError):
        return False
