"""How many WebSockets may be open at once, in all and of one login. Every WebSocket of the bridge is admitted here.

A page opens `/acp`, and beside it up to three sockets that only show something: the scene, its control, the robot's
camera. Those have a limit of their own, so that viewers never take the room of people who talk to the robot.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Awaitable, Callable

from starlette.responses import JSONResponse
from starlette.websockets import WebSocket

from backend.bridge.close_codes import TRY_AGAIN_LATER, CloseReason, close
from backend.bridge.login import SUBPROTOCOL, Authenticator, Login, LoginError
from backend.bridge.origin import OriginError
from backend.bridge.reading_pace import ReadingPace
from backend.bridge.websocket_protocol import SHORT_MESSAGE_BYTES, WebSocketProtocol
from backend.http_protocol import BACKLOG
from backend.identity import Identity, Right
from backend.tokens import RegistryError
from backend.wire import MAX_SHORT_FRAME_BYTES

SCENE_SOCKETS_PER_PAGE = 3
"""What a page opens beside `/acp`: the scene, its control, the robot's camera."""
DESCRIPTORS_PER_PAGE = 13
"""The most file descriptors that a page can take in this process: `/acp` 1, its agent as a child process 3, and three
scenes of 3 each, as both ends of viser's connections are in this process."""
RESERVED_DESCRIPTORS = 128
"""For everything else, above all for Stop: the robot server, the listening socket, logs."""

_ALL_ROOM_TAKEN = CloseReason(TRY_AGAIN_LATER, "Too many pages are open on this robot. Close one, or try again later.")
_LOGIN_ROOM_TAKEN = CloseReason(
    TRY_AGAIN_LATER, "This login is open in too many pages. Close one of them, or try again later."
)

Serve = Callable[[WebSocket, Login], Awaitable[CloseReason | None]]
"""Accepts and serves one WebSocket. Returns why to close it; None when it is closed already."""

log = logging.getLogger(__name__)


class ConnectionLimit:
    """Admits at most `total` WebSockets at once and `per_login` of each login.

    A quarter of `total` is reserved for people who may approve.
    """

    def __init__(
        self,
        authenticator: Authenticator,
        total: int,
        per_login: int,
        pace: ReadingPace | None = None,
        max_message_bytes: int = SHORT_MESSAGE_BYTES,
    ) -> None:
        """`max_message_bytes` is for people who may prompt; others have nothing long to say."""
        self._authenticator = authenticator
        self._total = total
        self._per_login = per_login
        self._pace = pace or ReadingPace()
        self._max_message_bytes = max_message_bytes
        self._open = Counter[str]()  # WebSockets, by login

    def endpoint(
        self, serve: Serve, authenticate: Callable[[WebSocket], Login] | None = None
    ) -> Callable[[WebSocket], Awaitable[None]]:
        """The ASGI endpoint that admits a WebSocket and then calls `serve`; `authenticate` raises as `admit` does."""

        async def admit(websocket: WebSocket) -> None:
            login = await _authenticate(authenticate or self._authenticator.admit, websocket)
            if login is None:
                return
            key = login.identity.person
            if (refusal := self._refusal(key, login.identity)) is not None:
                log.debug("%s refused for %s: %s", websocket.url.path, login.identity.name, refusal.reason)
                await _refuse(websocket, refusal)
                return
            most = self._max_message_bytes
            most = most if login.identity.may(Right.APPROVE) else min(most, MAX_SHORT_FRAME_BYTES)
            WebSocketProtocol.admitted(websocket.scope, self._pace.of(key), most)
            self._open[key] += 1
            try:
                reason = await serve(websocket, login)
                if reason is not None:
                    await close(websocket, reason)
            finally:
                self._open[key] -= 1
                if not self._open[key]:
                    del self._open[key]

        return admit

    def _refusal(self, key: str, identity: Identity) -> CloseReason | None:
        reserved = 0 if identity.may(Right.APPROVE) else self._total // 4
        if self._open.total() >= self._total - reserved:
            return _ALL_ROOM_TAKEN
        return _LOGIN_ROOM_TAKEN if self._open[key] >= self._per_login else None


def max_before_login_for(descriptors: int, wanted: int) -> int:
    """How many connections before login fit into a process that may open `descriptors` files: at most an eighth."""
    return max(8, min(wanted, descriptors // 8))


def max_pages_for(descriptors: int, wanted: int, before_login: int = 0) -> int:
    """How many pages fit beside `before_login` connections: at least 1, and `wanted` at most."""
    room = descriptors - RESERVED_DESCRIPTORS - (before_login + BACKLOG if before_login else 0)
    return max(1, min(wanted, room // DESCRIPTORS_PER_PAGE))


async def _authenticate(authenticate: Callable[[WebSocket], Login], websocket: WebSocket) -> Login | None:
    """The login that opens a WebSocket; None when the upgrade was refused with an HTTP answer."""
    await websocket.receive()
    try:
        return authenticate(websocket)
    except LoginError as error:
        answer = error.answer()
    except OriginError as error:
        answer = JSONResponse({"error": str(error)}, status_code=403)
    except RegistryError as error:
        answer = JSONResponse({"error": str(error)}, status_code=503)
    await websocket.send_denial_response(answer)
    return None


async def _refuse(websocket: WebSocket, reason: CloseReason) -> None:
    """Accept and close at once: no page can read an HTTP answer to its WebSocket, but each can read a close reason."""
    offered: list[str] = websocket.scope["subprotocols"]  # a browser insists on one of those that it offered
    await websocket.accept(subprotocol=next((name for name in offered if not name.startswith(SUBPROTOCOL)), None))
    await close(websocket, reason)
