"""A queue for one reader that may be slow: of each kind of message it keeps only the newest, so it never grows.

Messages are lost on purpose here. What has to arrive in full must not go through this queue.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Generic, TypeVar

from starlette.websockets import WebSocketDisconnect

from backend.bridge.close_codes import CLIENT_LEFT, POLICY_VIOLATION, CloseReason

SEND_SECONDS = 15.0
"""A client that does not take a frame within this time is disconnected."""
NOT_READING = CloseReason(POLICY_VIOLATION, "The page does not read.")

T = TypeVar("T")


class ConflatingQueue(Generic[T]):
    """The messages that wait for one reader, one of each kind."""

    def __init__(self) -> None:
        self._waiting: dict[str, T] = {}
        self._filled = asyncio.Event()  # set while a message waits

    def put(self, kind: str, message: T) -> None:
        """Add a message; it replaces a waiting one of the same kind."""
        self._waiting[kind] = message
        self._filled.set()

    async def take(self) -> list[T]:
        """Wait for a message, then return and remove all that wait."""
        await self._filled.wait()
        self._filled.clear()
        messages = list(self._waiting.values())
        self._waiting.clear()
        return messages


async def send_newest(queue: ConflatingQueue[T], send: Callable[[T], Awaitable[None]]) -> CloseReason:
    """Send the messages of `queue` until the client has left or does not read."""
    try:
        while True:
            for message in await queue.take():
                async with asyncio.timeout(SEND_SECONDS):
                    await send(message)
    except TimeoutError:
        return NOT_READING
    except WebSocketDisconnect:
        return CLIENT_LEFT
