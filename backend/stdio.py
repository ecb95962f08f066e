"""stdin and stdout as asyncio streams, whatever they are: pipes, sockets, a terminal, files, /dev/null."""

from __future__ import annotations

import asyncio
import contextlib
import os
import stat
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Protocol

from backend.gateway.closing import close

_CHUNK_BYTES = 64 * 1024


class Output(Protocol):
    """Where lines for the client go."""

    def write(self, data: bytes, /) -> None:
        """Take the bytes; they may wait. Raises `OSError`."""

    async def drain(self) -> None:
        """Return when there is room again. Raises `OSError` when nobody reads any more."""


@asynccontextmanager
async def stdin(limit: int) -> AsyncIterator[asyncio.StreamReader]:
    """stdin, for lines of up to `limit` bytes."""
    reader = asyncio.StreamReader(limit=limit)
    descriptor = sys.stdin.fileno()
    if _can_be_waited_for(descriptor):
        loop = asyncio.get_running_loop()
        transport, _ = await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin.buffer)
        with contextlib.closing(transport):
            yield reader
        return
    feeder = _Feeder(reader, descriptor)
    reader.set_transport(feeder)
    feeding = asyncio.create_task(feeder.feed(), name="stdin")
    try:
        yield reader
    finally:
        feeding.cancel()
        await asyncio.gather(feeding, return_exceptions=True)


@asynccontextmanager
async def stdout() -> AsyncIterator[Output]:
    """stdout; what still waits at the end is written, unless the client does not read."""
    descriptor = sys.stdout.fileno()
    if not _can_be_waited_for(descriptor):
        yield _File(descriptor)
        return
    loop = asyncio.get_running_loop()
    never_fed = asyncio.StreamReader()  # the protocol wants one; of all protocols, this one can drain
    transport, protocol = await loop.connect_write_pipe(
        lambda: asyncio.StreamReaderProtocol(never_fed), sys.stdout.buffer
    )
    writer = asyncio.StreamWriter(transport, protocol, never_fed, loop)
    try:
        yield writer
    finally:
        await close(writer)


def _can_be_waited_for(descriptor: int) -> bool:
    """False for files and devices such as /dev/null: they are always ready, and epoll refuses them."""
    mode = os.fstat(descriptor).st_mode
    return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode) or os.isatty(descriptor)


class _Feeder(asyncio.ReadTransport):
    """Reads a file for a stream reader, as fast as that is read."""

    def __init__(self, reader: asyncio.StreamReader, descriptor: int) -> None:
        super().__init__()
        self._reader = reader
        self._descriptor = descriptor
        self._wanted = asyncio.Event()
        self._wanted.set()

    async def feed(self) -> None:
        while data := os.read(self._descriptor, _CHUNK_BYTES):
            self._reader.feed_data(data)
            await asyncio.sleep(0)
            await self._wanted.wait()
        self._reader.feed_eof()

    def pause_reading(self) -> None:
        self._wanted.clear()

    def resume_reading(self) -> None:
        self._wanted.set()


class _File:
    """Writes to a file, which never makes anybody wait."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    def write(self, data: bytes, /) -> None:
        left = memoryview(data)
        while left:
            left = left[os.write(self._descriptor, left) :]

    async def drain(self) -> None:
        """There is always room."""
