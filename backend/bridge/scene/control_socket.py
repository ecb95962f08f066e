"""`WS /scene/<viewer>/control`: which view a page wants of its scene, and where its viewer clicked, as JSON.

And `POST /scene/<viewer>/moved`, by which viser's page reports that its viewer has moved the camera.

Both concern one viewer's camera and clicks. Nothing here may reach the robot or another viewer.
"""

from __future__ import annotations

import asyncio
import json
from typing import Literal

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.websockets import WebSocket

from backend import wire
from backend.bridge.close_codes import CLIENT_LEFT, REPLACED, TOO_LARGE, CloseReason
from backend.bridge.first_completed import first_completed
from backend.bridge.login import Authenticator, Login
from backend.bridge.scene.conflating_queue import send_newest
from backend.bridge.scene.scene import Scene
from backend.bridge.scene.ticket import SceneTickets
from backend.bridge.scene.viewers.viewer_id import invalid_id_response, refuse_invalid_id, viewer_id
from backend.bridge.scene.viewers.viewers import ControlQueue, Viewer
from backend.identity import Right

MAX_FRAME_BYTES = 1024
_FRAME_TOO_LARGE = CloseReason(TOO_LARGE, f"A message of this socket has at most {MAX_FRAME_BYTES} bytes.")
_REPLACED = CloseReason(REPLACED, "Another page took this viewer's place.")
_NOT_UNDERSTOOD = 'Send {"view": "map"}, "top" or "follow", or {"pick": true} or false.'
_MAY_NOT_PICK = "You watch only: a click here cannot become a request to the robot."


class _Request(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    view: Literal["map", "top", "follow"] | None = None
    pick: bool | None = None


_decoder = msgspec.json.Decoder(_Request)


class ControlSocket:
    """Serves the WebSockets between dashboards and the cameras of their scenes."""

    def __init__(self, authenticator: Authenticator, scene: Scene) -> None:
        self._authenticator = authenticator
        self._scene = scene

    async def serve(self, websocket: WebSocket, login: Login) -> CloseReason | None:
        """Serve one viewer's control until it leaves, another one replaces it, or its login ends."""
        identifier = viewer_id(websocket)
        if identifier is None:
            await refuse_invalid_id(websocket)
            return None
        await websocket.accept()
        queue = ControlQueue()
        with self._scene.viewers.viewer((login.identity.name, identifier)) as viewer:
            replaced = asyncio.Event()
            viewer.control_opened(queue, replaced.set)
            try:
                return await first_completed(
                    _read(websocket, viewer, queue, login),
                    send_newest(queue, lambda message: websocket.send_text(json.dumps(message, ensure_ascii=False))),
                    _wait_for_replacement(replaced),
                    self._authenticator.until_login_ends(login),
                )
            finally:
                viewer.control_closed(queue)


class CameraMoved:
    """`POST /scene/<viewer>/moved`: viser's page reports that its viewer has moved the camera."""

    def __init__(self, tickets: SceneTickets, scene: Scene) -> None:
        self._tickets = tickets
        self._scene = scene

    async def answer(self, request: Request) -> Response:
        """Free this viewer's camera. Raises `LoginError`, `OriginError` or `RegistryError`."""
        login = self._tickets.admit(request)
        identifier = viewer_id(request)
        if identifier is None:
            return invalid_id_response()
        self._scene.viewers.camera_taken((login.identity.name, identifier))
        return Response(status_code=204)


async def _read(websocket: WebSocket, viewer: Viewer, queue: ControlQueue, login: Login) -> CloseReason:
    may_pick = login.identity.may(Right.PROMPT)
    while True:
        message = await websocket.receive()
        if message["type"] == "websocket.disconnect":
            return CLIENT_LEFT
        text = message.get("text")
        frame = text.encode() if text is not None else message.get("bytes") or b""
        if len(frame) > MAX_FRAME_BYTES:
            return _FRAME_TOO_LARGE
        request = _parse(frame)
        if request is None:
            queue.put("error", {"error": _NOT_UNDERSTOOD})
            continue
        if request.view is not None:
            viewer.choose_view(request.view)
        if request.pick and not may_pick:
            queue.put("error", {"error": _MAY_NOT_PICK})
        elif request.pick is not None:
            viewer.set_picking(request.pick)


def _parse(frame: bytes) -> _Request | None:
    """The request in a frame; None for a frame that contains none."""
    try:
        request = _decoder.decode(frame)
    except wire.UNREADABLE:
        return None
    return request if request != _Request() else None


async def _wait_for_replacement(replaced: asyncio.Event) -> CloseReason:
    await replaced.wait()
    return _REPLACED
