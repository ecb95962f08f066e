"""How a WebSocket ends: the close code, and a reason that a client can show to the person in front of it."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from starlette.websockets import WebSocket, WebSocketDisconnect

NORMAL = 1000
POLICY_VIOLATION = 1008
TOO_LARGE = 1009
SERVICE_RESTART = 1012
TRY_AGAIN_LATER = 1013
LOGIN_ENDED = 4401
REPLACED = 4409

_CLOSE_SECONDS = 1.0


@dataclass(frozen=True)
class End:
    """Why a connection is over."""

    code: int
    reason: str


LEFT = End(NORMAL, "the client left")


async def close(websocket: WebSocket, end: End) -> None:
    """Tell the client, if it still listens."""
    try:
        async with asyncio.timeout(_CLOSE_SECONDS):
            await websocket.close(end.code, end.reason)
    except (WebSocketDisconnect, RuntimeError, TimeoutError):  # gone, closed already, or not reading
        pass
