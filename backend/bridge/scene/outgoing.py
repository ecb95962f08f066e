"""Sends what is newest to one reader, and gives up on one that does not read."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import TypeVar

from starlette.websockets import WebSocketDisconnect

from backend.bridge.closing import LEFT, POLICY_VIOLATION, End
from backend.bridge.scene.latest import Latest

SECONDS = 15.0
"""After so long a frame that is not taken ends the connection."""
UNREAD = End(POLICY_VIOLATION, "The page does not read.")

T = TypeVar("T")


async def send_latest(waiting: Latest[T], send: Callable[[T], Awaitable[None]]) -> End:
    """Send until the reader is gone."""
    try:
        while True:
            for message in await waiting.take():
                async with asyncio.timeout(SECONDS):
                    await send(message)
    except TimeoutError:
        return UNREAD
    except WebSocketDisconnect:
        return LEFT
