"""stdin and stdout as asyncio streams, whatever they are: pipes, sockets, a terminal, files, /dev/null.

Reading never keeps the process from ending, and never changes the mode of stdin, which the terminal or stdout may
share. Nothing here knows what the lines mean.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import select
import stat
import sys
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from backend.streams import close

_CHUNK_BYTES = 64 * 1024
_UNLIMITED = sys.maxsize


@asynccontextmanager
async def stdin(limit: int = _UNLIMITED, descriptor: int = 0) -> AsyncIterator[asyncio.StreamReader]:
    """stdin, or another file descriptor, for lines of up to `limit` bytes.

    It is read only as fast as the stream is. After the end of this context one more chunk may be read and lost.
    """
    reader = asyncio.StreamReader(limit=limit)
    thread = _ReadingThread(reader, descriptor)
    reader.set_transport(thread)
    thread.start()
    try:
        yield reader
    finally:
        thread.close()


@asynccontextmanager
async def stdout() -> AsyncIterator[asyncio.StreamWriter]:
    """stdout. At the end the bytes that wait are written, unless the client does not read."""
    descriptor = sys.stdout.fileno()
    loop = asyncio.get_running_loop()
    protocol = asyncio.StreamReaderProtocol(asyncio.StreamReader())  # its reader is never fed; it can drain
    if _can_be_waited_for(descriptor):
        transport, _ = await loop.connect_write_pipe(lambda: protocol, sys.stdout.buffer)
    else:
        transport = _FileTransport(descriptor, protocol)
    writer = asyncio.StreamWriter(transport, protocol, None, loop)
    try:
        yield writer
    finally:
        await close(writer)


def _can_be_waited_for(descriptor: int) -> bool:
    """False for files and devices such as /dev/null: they are always ready, and epoll refuses them."""
    mode = os.fstat(descriptor).st_mode
    return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode) or os.isatty(descriptor)


class _ReadingThread(asyncio.ReadTransport):
    """Reads a file descriptor in a daemon thread, which ends with the process.

    One chunk at a time is on its way to the event loop, so that a slow reader stops the thread.
    """

    def __init__(self, reader: asyncio.StreamReader, descriptor: int) -> None:
        super().__init__()
        self._reader = reader
        self._descriptor = descriptor
        self._loop = asyncio.get_running_loop()
        self._paused = False
        self._closed = False
        self._may_read = threading.Event()
        """Set while the thread may read the next chunk."""

    def start(self) -> None:
        """Begin to read."""
        threading.Thread(target=self._read, name="stdin", daemon=True).start()

    def _read(self) -> None:
        with contextlib.suppress(RuntimeError):  # the event loop has ended
            while not self._closed:
                self._may_read.clear()
                chunk = self._next_chunk()
                self._loop.call_soon_threadsafe(self._feed, chunk)
                if not chunk:
                    return
                self._may_read.wait()

    def _next_chunk(self) -> bytes:
        """The next bytes; none at the end, and when the descriptor fails."""
        while True:
            try:
                # Not sys.stdin: a daemon thread that holds the lock of its buffer aborts the interpreter at its exit.
                return os.read(self._descriptor, _CHUNK_BYTES)
            except BlockingIOError:  # stdout is the same terminal, and was made non-blocking
                select.select([self._descriptor], [], [])
            except OSError:
                return b""

    def _feed(self, chunk: bytes) -> None:
        if not chunk:
            self._reader.feed_eof()
            return
        self._reader.feed_data(chunk)
        if not self._paused or self._closed:
            self._may_read.set()

    def pause_reading(self) -> None:
        """The stream holds enough."""
        self._paused = True

    def resume_reading(self) -> None:
        """The stream wants more."""
        self._paused = False
        self._may_read.set()

    def is_closing(self) -> bool:
        """Whether `close` was called."""
        return self._closed

    def close(self) -> None:
        """Feed no more."""
        self._closed = True
        self._may_read.set()


class _FileTransport(asyncio.WriteTransport):
    """Writes to a file, which never makes anybody wait."""

    def __init__(self, descriptor: int, protocol: asyncio.BaseProtocol) -> None:
        super().__init__()
        self._descriptor = descriptor
        self._protocol = protocol
        self._closed = False

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Write everything at once. Raises `OSError`, as for a disk that is full."""
        rest = memoryview(data)
        while rest:
            rest = rest[os.write(self._descriptor, rest) :]

    def is_closing(self) -> bool:
        """Whether `close` was called."""
        return self._closed

    def close(self) -> None:
        """Write no more. The file stays open, as it belongs to the process."""
        if not self._closed:
            self._closed = True
            asyncio.get_running_loop().call_soon(self._protocol.connection_lost, None)

    def abort(self) -> None:
        """The same, as nothing ever waits to be written."""
        self.close()
