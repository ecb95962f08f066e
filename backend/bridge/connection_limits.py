"""The door of a WebSocket: who comes in, and how many at once. Every WebSocket of the bridge has one.

A page opens `/acp`, and beside it the scene, the scene's control and the camera. The sockets to look through have a
door of their own, so that no crowd of onlookers ever takes the place of somebody who talks to the robot.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Awaitable, Callable

from starlette.responses import JSONResponse
from starlette.websockets import WebSocket

from backend.bridge.closing import TRY_AGAIN_LATER, End, close
from backend.bridge.login import SUBPROTOCOL, Gate, Login, LoginError
from backend.bridge.origin import OriginError
from backend.identity import Identity, Right
from backend.tokens import RegistryError

PAGES_A_LOGIN = 32
"""Pages that one login may have open: more than a person has, so that one person alone never fills the house."""
SOCKETS_TO_LOOK = 3
"""What a page opens beside `/acp`."""
DESCRIPTORS_A_PAGE = 13
"""Of the process, the most that a page can open: `/acp` 1, its agent a child process with 3, and three times the scene,
which takes 3 each, as viser's two ends are in this process."""
DESCRIPTORS_KEPT = 128
"""For everything else, Stop before all: logs, the listening socket, the robot server, plain HTTP."""

_HOUSE_FULL = End(TRY_AGAIN_LATER, "Too many pages are open on this robot. Close one, or try again later.")
_LOGIN_FULL = End(TRY_AGAIN_LATER, "This login is open in too many pages. Close one of them, or try again later.")

Serve = Callable[[WebSocket, Login], Awaitable[End | None]]
"""Accepts and serves one WebSocket, and returns its end; None when it has told the client already."""

log = logging.getLogger(__name__)


class Door:
    """Lets at most `room` WebSockets in at once, three quarters of them for people who may not approve, and of each
    login `room_a_login`."""

    def __init__(self, gate: Gate, room: int, room_a_login: int) -> None:
        self._gate = gate
        self._room = room
        self._room_a_login = room_a_login
        self._inside = Counter[str]()  # WebSockets, by login

    def to(self, serve: Serve) -> Callable[[WebSocket], Awaitable[None]]:
        """The endpoint that leads to `serve` through this door."""

        async def enter(websocket: WebSocket) -> None:
            login = await _admit(self._gate, websocket)
            if login is None:
                return
            who = login.identity.token_id or login.identity.name
            if (full := self._full(who, login.identity)) is not None:
                log.debug("%s refused for %s: %s", websocket.url.path, login.identity.name, full.reason)
                await _turn_away(websocket, full)
                return
            self._inside[who] += 1
            try:
                end = await serve(websocket, login)
                if end is not None:
                    await close(websocket, end)
            finally:
                self._inside[who] -= 1
                if not self._inside[who]:
                    del self._inside[who]

        return enter

    def _full(self, who: str, identity: Identity) -> End | None:
        # A quarter is kept for those who answer for the robot: no crowd of viewers shuts them out.
        kept = 0 if identity.may(Right.APPROVE) else self._room // 4
        if self._inside.total() >= self._room - kept:
            return _HOUSE_FULL
        return _LOGIN_FULL if self._inside[who] >= self._room_a_login else None


def pages_for(descriptors: int, wanted: int) -> int:
    """How many pages there is room for, `wanted` at most, in a process that may open so many descriptors."""
    return max(1, min(wanted, (descriptors - DESCRIPTORS_KEPT) // DESCRIPTORS_A_PAGE))


async def _admit(gate: Gate, websocket: WebSocket) -> Login | None:
    """Who opens a WebSocket; None when the upgrade was refused with an HTTP answer."""
    await websocket.receive()
    try:
        return gate.admit(websocket)
    except LoginError as error:
        refusal = JSONResponse({"error": str(error)}, status_code=401)
    except OriginError as error:
        refusal = JSONResponse({"error": str(error)}, status_code=403)
    except RegistryError as error:
        refusal = JSONResponse({"error": str(error)}, status_code=503)
    await websocket.send_denial_response(refusal)
    return None


async def _turn_away(websocket: WebSocket, end: End) -> None:
    """Let in to say why not: no page can read an HTTP answer to its WebSocket."""
    offered: list[str] = websocket.scope["subprotocols"]  # a browser wants one of them back
    await websocket.accept(subprotocol=next((name for name in offered if not name.startswith(SUBPROTOCOL)), None))
    await close(websocket, end)
