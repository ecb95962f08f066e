"""`robot-acp listen`: a remote robot as a TCP agent on this machine's loopback, and nowhere else.

Whoever reaches the port has the rights of the token, so a connection that does not begin with `initialize` is closed
at once: a web page can post to a local port, but it cannot begin like this. Until then a connection has little time and
room, and beyond `MAX_BEFORE_INITIALIZE` the oldest one is closed.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable

from backend import wire
from backend.connections_before_login import ConnectionsBeforeLogin
from backend.gateway.pipe import Pipe
from backend.gateway.remote import Address, RemoteError
from backend.streams import close

HOST = "127.0.0.1"
MAX_BEFORE_INITIALIZE = 64
_FIRST_LINE_SECONDS = 30.0
_FIRST_LINE_BYTES = 64 * 1024
_STREAM_LIMIT = 64 * 1024
"""So much of a line is read at a time; a longer one is put together as it is read."""

log = logging.getLogger(__name__)


async def serve(address: Address, port: int) -> None:
    """Serve until cancelled; each client has a connection of its own to the remote. Raises `OSError`."""
    clients: set[asyncio.Task[None]] = set()
    strangers = ConnectionsBeforeLogin(MAX_BEFORE_INITIALIZE, MAX_BEFORE_INITIALIZE)

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None  # noqa: S101 - a coroutine always runs in a task
        clients.add(task)
        strangers.add(writer, None, writer.transport.abort)
        try:
            await _serve_client(address, reader, writer, lambda: strangers.remove(writer))
        finally:
            strangers.remove(writer)
            clients.discard(task)

    server = await asyncio.start_server(accept, HOST, port, limit=_STREAM_LIMIT)
    log.info("%s is on tcp://%s:%d", address.url, *server.sockets[0].getsockname()[:2])
    try:
        async with server:
            await server.serve_forever()
    finally:
        for task in list(clients):
            task.cancel()
        await asyncio.gather(*clients, return_exceptions=True)


async def _serve_client(
    address: Address, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, admit: Callable[[], None]
) -> None:
    """Serve one client; `admit` is called once it has begun with `initialize`."""
    connected: socket.socket = writer.get_extra_info("socket")
    connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    try:
        first = await _first_line(reader)
        if first is None:
            log.warning("closed a connection that did not begin with initialize")
        else:
            admit()
            await _relay(address, first, reader, writer)
    finally:
        await close(writer)


async def _first_line(reader: asyncio.StreamReader) -> wire.Frame | None:
    """The request to initialize; None when the client begins with anything else, or with nothing in time."""
    try:
        async with asyncio.timeout(_FIRST_LINE_SECONDS):
            line = await wire.read_line(reader, _FIRST_LINE_BYTES, skip=False)
        frame = wire.check(line) if line is not None else None
    except (wire.BadFrame, OSError, TimeoutError):
        return None
    return frame if frame and frame.kind == "request" and frame.method == "initialize" else None


async def _relay(
    address: Address, first: wire.Frame, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
) -> None:
    try:
        remote = await address.connect()
    except RemoteError as error:
        log.error("%s", error)
        writer.write(wire.error_frame(first.id, wire.INTERNAL_ERROR, str(error)) + b"\n")
        return
    try:
        await Pipe(reader, writer, remote).run(first)
    except RemoteError as error:
        log.error("%s", error)
    finally:
        await remote.close()
