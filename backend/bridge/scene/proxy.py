"""`/scene/` and `WS /scene`, or with a viewer's id behind them: viser behind the bridge's login, on the bridge's port.

viser listens on loopback, for this proxy alone (`viser_port`). Nothing that a browser sends may be passed on to it: its
messages can change what others see, and one of them opens a tunnel to the internet. So the proxy itself reads what a
page reports (where its camera stands, and clicks), and answers it.
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

from backend.bridge.close_codes import CLIENT_LEFT, TRY_AGAIN_LATER, CloseReason
from backend.bridge.first_completed import first_completed
from backend.bridge.login import Authenticator, Login
from backend.bridge.scene import viser_internals, viser_port
from backend.bridge.scene.conflating_queue import NOT_READING, SEND_SECONDS, send_newest
from backend.bridge.scene.drawing.camera_views import View
from backend.bridge.scene.scene import Scene, SceneUnavailableError
from backend.bridge.scene.ticket import SceneTickets
from backend.bridge.scene.viewers.viewer_camera import CameraReport
from backend.bridge.scene.viewers.viewer_id import invalid_id_response, refuse_invalid_id, viewer_id
from backend.bridge.scene.viewers.viewers import PageQueue, Viewer

_START_SECONDS = 20.0
_NOT_READY = CloseReason(TRY_AGAIN_LATER, "The scene is not ready.")

log = logging.getLogger(__name__)


class ScenePage:
    """viser's page. It is fetched from viser once and kept; each viewer's has a ticket in it."""

    def __init__(self, authenticator: Authenticator, scene: Scene, tickets: SceneTickets) -> None:
        self._authenticator = authenticator
        self._scene = scene
        self._tickets = tickets
        self._page: str | None = None
        self._version = ""  # of the page, set with it

    async def answer(self, request: Request) -> Response:
        """`GET /scene/` and `GET /scene/<viewer>/`, the same page. Raises `LoginError` or `RegistryError`."""
        who = self._authenticator.authenticate(request).identity
        viewer = viewer_id(request) if "viewer" in request.path_params else ""
        if viewer is None:
            return invalid_id_response()
        try:
            page = self._page or await self._fetch()
        except SceneUnavailableError as error:
            return JSONResponse({"error": str(error)}, status_code=503)
        ticket = self._tickets.make(who, viewer)
        etag = f'"{hashlib.sha256((self._version + ticket).encode()).hexdigest()[:32]}"'
        text = page.replace(viser_internals.TICKET, ticket, 1)
        headers = {
            "Content-Security-Policy": viser_internals.CONTENT_SECURITY_POLICY,
            "Cache-Control": "private, no-cache",
            "ETag": etag,
        }
        if request.headers.get("if-none-match") == etag:
            return Response(status_code=304, headers=headers)
        return HTMLResponse(text, headers=headers)

    async def _fetch(self) -> str:
        try:
            async with asyncio.timeout(_START_SECONDS), httpx.AsyncClient(trust_env=False) as client:
                address = f"http://127.0.0.1:{await self._scene.port()}/"
                answer = await client.get(address, headers=viser_port.SECRET_HEADERS)
                answer.raise_for_status()
        except (httpx.HTTPError, TimeoutError):
            raise SceneUnavailableError("The scene is not ready. Try again in a moment.") from None
        self._page = viser_internals.patched_page(answer.text)
        self._version = hashlib.sha256(self._page.encode()).hexdigest()
        return self._page


async def redirect_to_slash(request: Request) -> Response:
    """`GET /scene`: the page finds its WebSocket relative to its own address, which has to end in a slash."""
    if "viewer" in request.path_params:
        identifier = viewer_id(request)
        if identifier is None:
            return invalid_id_response()
        return RedirectResponse(f"/scene/{identifier}/", status_code=308)
    return RedirectResponse("/scene/", status_code=308)


class SceneSocket:
    """Serves the WebSockets between the viewers' pages and viser."""

    def __init__(self, authenticator: Authenticator, scene: Scene) -> None:
        self._authenticator = authenticator
        self._scene = scene

    async def serve(self, websocket: WebSocket, login: Login) -> CloseReason | None:
        """Relay viser to one page until either side has closed, or the login ends."""
        identifier = viewer_id(websocket) if "viewer" in websocket.path_params else uuid.uuid4().hex
        if identifier is None:
            await refuse_invalid_id(websocket)
            return None
        with self._scene.viewers.viewer((login.identity.name, identifier)) as viewer:
            return await self._relay(websocket, login, viewer)

    async def _relay(self, websocket: WebSocket, login: Login, viewer: Viewer) -> CloseReason:
        offered = [
            Subprotocol(name)
            for name in websocket.scope["subprotocols"]
            if name.startswith(viser_internals.SUBPROTOCOL_PREFIX)
        ]
        try:
            async with asyncio.timeout(_START_SECONDS):
                port = await self._scene.port()
            async with connect(
                f"ws://127.0.0.1:{port}/",
                subprotocols=offered or None,
                additional_headers=viser_port.SECRET_HEADERS,
                compression=None,
                proxy=None,
                max_size=None,
                ping_interval=None,
            ) as viser:
                await websocket.accept(subprotocol=viser.subprotocol)
                queue = PageQueue()
                viewer.page_opened(queue)
                try:
                    with self._scene.watched():
                        return await first_completed(
                            self._read(websocket, viewer, queue),
                            _pass_on(viser, websocket),
                            send_newest(queue, websocket.send_bytes),
                            self._authenticator.until_login_ends(login),
                        )
                finally:
                    viewer.page_closed(queue)
        except (SceneUnavailableError, OSError, WebSocketException, TimeoutError) as error:
            log.warning("scene: viser cannot be reached: %s", error)
            return _NOT_READY

    async def _read(self, websocket: WebSocket, viewer: Viewer, queue: PageQueue) -> CloseReason:
        while True:
            message = await websocket.receive()
            if message["type"] == "websocket.disconnect":
                return CLIENT_LEFT
            match viser_internals.decode(message.get("bytes") or b""):
                case viser_internals.PageCamera(position, look_at, aspect):
                    viewer.camera_reported(queue, CameraReport(View(position, look_at), aspect))
                case viser_internals.Click() as click:
                    self._scene.viewers.clicked(viewer, queue, click)


async def _pass_on(viser: ClientConnection, websocket: WebSocket) -> CloseReason:
    try:
        async for frame in viser:
            async with asyncio.timeout(SEND_SECONDS):
                await websocket.send_bytes(frame if isinstance(frame, bytes) else frame.encode())
    except TimeoutError:
        return NOT_READING
    except WebSocketDisconnect:
        return CLIENT_LEFT
    except ConnectionClosed:
        pass
    return _NOT_READY
