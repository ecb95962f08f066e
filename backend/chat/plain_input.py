"""The lines of a standard input that is no terminal, without ever keeping the process from ending."""

from __future__ import annotations

import asyncio
import os
import threading
from collections.abc import AsyncIterator, Callable


async def lines(at_once: Callable[[str], bool]) -> AsyncIterator[str]:
    """Each line in its turn, until the input ends, but for those that `at_once` takes as they come."""
    loop = asyncio.get_running_loop()
    read_so_far: asyncio.Queue[str | None] = asyncio.Queue()

    def take(line: str) -> None:
        if not at_once(line):
            read_so_far.put_nowait(line)

    def read() -> None:
        # Below Python's own buffer, whose lock would keep the process from ending while this waits.
        with os.fdopen(os.dup(0), "rb", buffering=0) as stdin:
            for line in stdin:
                loop.call_soon_threadsafe(take, line.decode("utf-8", "replace"))
        loop.call_soon_threadsafe(read_so_far.put_nowait, None)

    threading.Thread(target=read, name="stdin", daemon=True).start()
    while (line := await read_so_far.get()) is not None:
        yield line
