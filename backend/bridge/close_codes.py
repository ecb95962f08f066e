"""The close codes of the bridge's WebSockets (RFC 6455, section 7.4; from 4000 on our own), and how one is closed.

The reason is a sentence that a client can show to the person in front of it.
"""

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
class CloseReason:
    """Why a connection is closed: a close code and a sentence."""

    code: int
    reason: str


CLIENT_LEFT = CloseReason(NORMAL, "the client left")


async def close(websocket: WebSocket, why: CloseReason) -> None:
    """Close `websocket`; does nothing where its client is gone or does not read."""
    try:
        async with asyncio.timeout(_CLOSE_SECONDS):
            await websocket.close(why.code, why.reason)
    except (WebSocketDisconnect, RuntimeError, TimeoutError):  # gone, closed already, or not reading
        pass
