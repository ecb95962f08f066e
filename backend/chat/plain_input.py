"""The lines of a standard input that is no terminal: for scripts, pipes and tests."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable

from backend.stdio import stdin


async def lines(at_once: Callable[[str], bool]) -> AsyncIterator[str]:
    """Each line when it is asked for, until the input ends.

    `at_once` is called with each line as soon as it arrives. The lines for which it returns true are done with that.
    """
    waiting: asyncio.Queue[str | None] = asyncio.Queue()

    async def read() -> None:
        async with stdin() as reader:
            async for raw in reader:
                line = raw.decode("utf-8", "replace")
                if not at_once(line):
                    waiting.put_nowait(line)
        waiting.put_nowait(None)

    reading = asyncio.create_task(read(), name="stdin")
    try:
        while (line := await waiting.get()) is not None:
            yield line
    finally:
        reading.cancel()
        await asyncio.gather(reading, return_exceptions=True)
