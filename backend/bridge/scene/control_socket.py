"""`WS /scene/<viewer>/control`: what a viewer wants to look at, and where it clicked, as JSON beside the scene's page.

And `POST /scene/<viewer>/moved`, from that page itself.

It moves this viewer's camera and tells this viewer's clicks. Nothing here reaches the robot or another viewer.
"""

from __future__ import annotations

import asyncio
import json
from typing import Any, Literal

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.websockets import WebSocket

from backend.bridge.closing import LEFT, REPLACED, TOO_LARGE, End
from backend.bridge.login import Gate, Login
from backend.bridge.race import first_of
from backend.bridge.scene.outgoing import send_latest
from backend.bridge.scene.scene import Scene
from backend.bridge.scene.viewer_id import refusal, refuse, viewer_id
from backend.bridge.scene.viewers import Control, Viewer
from backend.identity import Right

MAX_FRAME_BYTES = 1024
_TOO_LARGE = End(TOO_LARGE, f"A message of this socket has at most {MAX_FRAME_BYTES} bytes.")
_REPLACED = End(REPLACED, "Another page took this viewer's place.")
_NOT_UNDERSTOOD = 'Send {"view": "map"}, "top" or "follow", or {"pick": true} or false.'
_WATCHES = "You watch only: a click here cannot become a request to the robot."


class _Wish(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    view: Literal["map", "top", "follow"] | None = None
    pick: bool | None = None


_decoder = msgspec.json.Decoder(_Wish)


class SceneControl:
    """The WebSocket between a dashboard and its viewer's camera."""

    def __init__(self, gate: Gate, scene: Scene) -> None:
        self._gate = gate
        self._scene = scene

    async def serve(self, websocket: WebSocket, login: Login) -> End | None:
        """Serve one viewer's control, until it leaves, another one comes, or its login ends."""
        identifier = viewer_id(websocket)
        if identifier is None:
            await refuse(websocket)
            return None
        await websocket.accept()
        control = Control()
        with self._scene.viewers.viewer((login.identity.name, identifier)) as viewer:
            replaced = asyncio.Event()
            viewer.control_opened(control, replaced.set)
            try:
                return await first_of(
                    _listen(websocket, viewer, control, login),
                    send_latest(control, lambda message: websocket.send_text(json.dumps(message, ensure_ascii=False))),
                    _until(replaced),
                    self._gate.until_ended(login),
                )
            finally:
                viewer.control_closed(control)


class CameraMoved:
    """`POST /scene/<viewer>/moved`: what the scene's page says when its viewer takes the camera in hand."""

    def __init__(self, gate: Gate, scene: Scene) -> None:
        self._gate = gate
        self._scene = scene

    async def answer(self, request: Request) -> Response:
        """Note it. Raises `LoginError` or `OriginError`."""
        login = self._gate.admit(request)
        identifier = viewer_id(request)
        if identifier is None:
            return refusal()
        self._scene.viewers.moved((login.identity.name, identifier))
        return Response(status_code=204)


async def _listen(websocket: WebSocket, viewer: Viewer, control: Control, login: Login) -> End:
    may_pick = login.identity.may(Right.PROMPT)
    while True:
        message = await websocket.receive()
        if message["type"] == "websocket.disconnect":
            return LEFT
        wish = _understood(message)
        if wish is _TOO_LARGE:
            return _TOO_LARGE
        if not isinstance(wish, _Wish):
            control.put("error", {"error": _NOT_UNDERSTOOD})
            continue
        if wish.view is not None:
            viewer.choose(wish.view)
        if wish.pick and not may_pick:
            control.put("error", {"error": _WATCHES})
        elif wish.pick is not None:
            viewer.pick(wish.pick)


def _understood(message: Any) -> _Wish | End | None:
    """What a frame asks for; None for what makes no sense."""
    text = message.get("text")
    frame = text.encode() if text is not None else message.get("bytes") or b""
    if len(frame) > MAX_FRAME_BYTES:
        return _TOO_LARGE
    try:
        wish = _decoder.decode(frame)
    except msgspec.MsgspecError:
        return None
    return wish if wish != _Wish() else None


async def _until(replaced: asyncio.Event) -> End:
    await replaced.wait()
    return _REPLACED
