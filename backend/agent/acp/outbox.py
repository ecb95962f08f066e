"""The messages that wait to be sent to one client: one ordered queue, and beside it the newest frame of each method
whose frames are of use only while they are new.

Putting a frame in never waits for the client. The connection that owns the outbox limits how much may wait in it.
"""

from __future__ import annotations

import asyncio

REPLAY_BYTES = 1024 * 1024
"""A replay puts in no more while more than this waits."""


class Outbox:
    """The outbox of one stream. `send` has to be running for anything to leave."""

    def __init__(self, writer: asyncio.StreamWriter) -> None:
        self.closed = False
        """Set when the outbox takes no more frames: the client is gone, was cut off, or is being left."""
        self.waiting_bytes = 0
        """Size of the queued frames that the transport has not taken yet."""
        self._writer = writer
        self._queue: list[bytes] = []
        self._latest: dict[str, bytes] = {}
        """Method -> its newest frame, not sent yet."""
        self._filled = asyncio.Event()
        self._sent = asyncio.Event()
        """Set while nothing is queued, and once nothing will be sent any more."""
        self._sent.set()

    def put(self, frame: bytes) -> None:
        """Queue a frame behind all others. A closed outbox drops it."""
        if self.closed:
            return
        self._queue.append(frame)
        self.waiting_bytes += len(frame)
        self._sent.clear()
        self._filled.set()

    def put_latest(self, method: str, frame: bytes) -> None:
        """Send a frame soon, unless a newer one of its method is put in before."""
        self._latest[method] = frame
        self._filled.set()

    async def wait_for_space(self) -> None:
        """Return when at most `REPLAY_BYTES` wait, or nothing will be sent any more."""
        while self.waiting_bytes > REPLAY_BYTES and not self.closed:
            await self._sent.wait()

    async def wait_until_sent(self) -> None:
        """Return when the transport has taken every queued frame, or nothing will be sent any more."""
        await self._sent.wait()

    async def send(self) -> None:
        """Pass the frames to the transport as it takes them, until it fails."""
        while True:
            await self._filled.wait()
            self._filled.clear()
            queued, latest = b"".join(self._queue), b"".join(self._latest.values())
            self._queue.clear()
            self._latest.clear()
            try:
                self._writer.write(queued + latest)
                await self._writer.drain()
            except OSError:
                self.closed = True
                self._sent.set()
                return
            self.waiting_bytes -= len(queued)
            if not self._queue:
                self._sent.set()

    def close(self) -> None:
        """Take no more frames; those that wait are still sent."""
        self.closed = True

    def abort(self) -> None:
        """Break the connection at once; the frames that wait are lost."""
        self.closed = True
        self._sent.set()
        self._writer.transport.abort()

    def finish(self) -> None:
        """Hand the rest of the queue to the transport and close it. `send` must not be running any more."""
        self.closed = True
        self._sent.set()
        self._writer.write(b"".join(self._queue))
        self._writer.close()
