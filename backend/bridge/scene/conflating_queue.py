"""What waits to be sent to somebody who may read slowly: of each kind the newest alone, so nothing ever piles up."""

from __future__ import annotations

import asyncio
from typing import Generic, TypeVar

T = TypeVar("T")


class Latest(Generic[T]):
    """One reader's waiting messages, by kind."""

    def __init__(self) -> None:
        self._waiting: dict[str, T] = {}
        self._wake = asyncio.Event()  # set while something waits

    def put(self, kind: str, message: T) -> None:
        """Send this, in place of what waits of the same kind."""
        self._waiting[kind] = message
        self._wake.set()

    async def take(self) -> list[T]:
        """All that waits, once there is something."""
        await self._wake.wait()
        self._wake.clear()
        messages = list(self._waiting.values())
        self._waiting.clear()
        return messages
