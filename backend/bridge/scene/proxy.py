"""`/scene/` and `WS /scene`, or with a viewer's id behind: viser behind the bridge's login, on the bridge's own port.

viser itself listens on loopback and asks nobody who they are. Nothing that a browser sends is passed on to it: that
could change what others see, and one of viser's messages opens a tunnel to the internet. Where a viewer's camera
stands and where it clicks is read here, and answered here.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
import uuid

import httpx
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.typing import Subprotocol

from backend.bridge.closing import LEFT, TRY_AGAIN_LATER, End
from backend.bridge.login import Gate, Login
from backend.bridge.race import first_of
from backend.bridge.scene import page as visers_page
from backend.bridge.scene import viser_wire
from backend.bridge.scene.eye import Report
from backend.bridge.scene.outgoing import SECONDS, UNREAD, send_latest
from backend.bridge.scene.scene import Scene, SceneDownError
from backend.bridge.scene.viewer_id import refusal, refuse, viewer_id
from backend.bridge.scene.viewers import Page, Viewer

_START_SECONDS = 20.0
_NOT_READY = End(TRY_AGAIN_LATER, "The scene is not ready.")

log = logging.getLogger(__name__)


class ScenePage:
    """The page. It is fetched from viser once and kept."""

    def __init__(self, gate: Gate, scene: Scene) -> None:
        self._gate = gate
        self._scene = scene
        self._page: str | None = None
        self._etag = ""

    async def answer(self, request: Request) -> Response:
        """`GET /scene/` and `GET /scene/<viewer>/`, the same page. Raises `LoginError`."""
        self._gate.login(request)
        if "viewer" in request.path_params and viewer_id(request) is None:
            return refusal()
        try:
            text = self._page or await self._fetch()
        except SceneDownError as error:
            return JSONResponse({"error": str(error)}, status_code=503)
        headers = {
            "Content-Security-Policy": visers_page.POLICY,
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
        self._page = visers_page.patched(answer.text)
        self._etag = f'"{hashlib.sha256(self._page.encode()).hexdigest()[:32]}"'
        return self._page


async def with_slash(request: Request) -> Response:
    """`GET /scene`: the page finds its WebSocket by its own address, which has to end in a slash."""
    if "viewer" in request.path_params:
        identifier = viewer_id(request)
        return refusal() if identifier is None else RedirectResponse(f"/scene/{identifier}/", status_code=308)
    return RedirectResponse("/scene/", status_code=308)


class SceneSocket:
    """The WebSocket between a viewer's page and viser."""

    def __init__(self, gate: Gate, scene: Scene) -> None:
        self._gate = gate
        self._scene = scene

    async def serve(self, websocket: WebSocket, login: Login) -> End | None:
        """Relay one viewer, until either side is gone, or the login ends."""
        identifier = viewer_id(websocket) if "viewer" in websocket.path_params else uuid.uuid4().hex
        if identifier is None:
            await refuse(websocket)
            return None
        with self._scene.viewers.viewer((login.identity.name, identifier)) as viewer:
            return await self._relay(websocket, login, viewer)

    async def _relay(self, websocket: WebSocket, login: Login, viewer: Viewer) -> End:
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
                page = Page()
                viewer.page_opened(page)
                try:
                    with self._scene.watched():
                        return await first_of(
                            self._listen(websocket, viewer, page),
                            _pass_on(viser, websocket),
                            send_latest(page, websocket.send_bytes),
                            self._gate.until_ended(login),
                        )
                finally:
                    viewer.page_closed(page)
        except (SceneDownError, OSError, WebSocketException, TimeoutError) as error:
            log.warning("scene: viser cannot be reached: %s", error)
            return _NOT_READY

    async def _listen(self, websocket: WebSocket, viewer: Viewer, page: Page) -> End:
        while True:
            message = await websocket.receive()
            if message["type"] == "websocket.disconnect":
                return LEFT
            match viser_wire.decode(message.get("bytes") or b""):
                case Report() as report:
                    viewer.reported(page, report)
                case viser_wire.Click() as click:
                    self._scene.viewers.clicked(viewer, page, click)


async def _pass_on(viser: ClientConnection, websocket: WebSocket) -> End:
    try:
        async for frame in viser:
            async with asyncio.timeout(SECONDS):
                await websocket.send_bytes(frame if isinstance(frame, bytes) else frame.encode())
    except TimeoutError:
        return UNREAD
    except WebSocketDisconnect:
        return LEFT
    except ConnectionClosed:
        pass
    return _NOT_READY
