"""Both directions between one local client and the remote, message by message, as the bytes that came.

It keeps the ids of the client's open requests and nothing else: when the remote is lost, each of them is answered with
an error. While one side is slow, the other is not read.
"""

from __future__ import annotations

import asyncio
import logging

from backend import wire
from backend.gateway.remote import Remote, RemoteError

log = logging.getLogger(__name__)


class Pipe:
    """One client and one remote. Neither is closed here."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, remote: Remote) -> None:
        self._reader = reader
        self._writer = writer
        self._remote = remote
        self._open: set[wire.RequestId] = set()

    async def run(self, first: wire.Frame | None = None) -> None:
        """Pass messages on, `first` before all others, until the client leaves.

        Raises `RemoteError` when the remote is lost first; the client has its answers then.
        """
        up = asyncio.create_task(self._up(first), name="to the remote")
        down = asyncio.create_task(self._down(), name="from the remote")
        try:
            await asyncio.wait((up, down), return_when=asyncio.FIRST_COMPLETED)
            if up.done() and up.result() == "client left":
                return
            # A remote that takes no more messages may still have sent some, and the reason why it closed.
            await down
        except RemoteError as error:
            await self._answer_open_requests(str(error))
            raise
        finally:
            up.cancel()
            down.cancel()
            await asyncio.gather(up, down, return_exceptions=True)

    async def _up(self, frame: wire.Frame | None) -> str:
        while True:
            try:
                if frame is None:
                    line = await wire.read_line(self._reader)
                    if line is None:
                        return "client left"
                    frame = wire.check(line)
                if frame.kind == "request" and frame.id is not None:
                    self._open.add(frame.id)
                await self._remote.send(frame)
                frame = None
            except wire.BadFrame as bad:
                if bad.reply is not None and not await self._write(bad.reply):
                    return "client left"
            except RemoteError:
                return "remote lost"
            except OSError:
                return "client left"

    async def _down(self) -> None:
        """Pass on what the remote sends; return when the client no longer reads."""
        while True:
            try:
                frame = wire.check(await self._remote.receive())
            except wire.BadFrame as bad:
                log.warning("dropped a message of the remote: %s", bad.message)
                continue
            if frame.kind == "response":
                self._open.discard(frame.id)
            if not await self._write(frame.raw):
                return

    async def _answer_open_requests(self, sentence: str) -> None:
        for request_id in self._open:
            await self._write(wire.error_frame(request_id, wire.INTERNAL_ERROR, sentence))
        self._open.clear()

    async def _write(self, line: bytes) -> bool:
        """Write a line to the client; false when it no longer reads."""
        try:
            self._writer.write(line + b"\n")
            await self._writer.drain()
        except OSError:
            return False
        return True
