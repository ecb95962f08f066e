"""A proxy between a browser and the bridge, over HTTP/1.1, that can keep requests waiting or answer them itself."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass, field

from tests.processes import free_port

PORTAL = "<!doctype html><html lang=en><title>Guest network</title><p>Please accept the terms."


@dataclass
class Proxy:
    """Passes each connection on to `target`, after a look at its first request line."""

    target: int
    port: int = field(default_factory=free_port)
    kept: tuple[str, ...] = ()
    """Beginnings of addresses that are never answered; WebSockets are."""
    portal: tuple[str, ...] = ()
    """Beginnings of addresses that are answered with a page of HTML and status 200."""
    missing: tuple[str, ...] = ()
    """Beginnings of addresses that are answered with 404, as those of a build that was replaced."""
    waiting: int = 0
    """Requests that wait for an answer that never comes."""
    most_waiting: int = 0

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError, asyncio.IncompleteReadError):
            await self._answer(reader, writer)
        writer.close()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = await reader.readuntil(b"\r\n\r\n")
        path = head.split(b" ", 2)[1].decode()
        if path.startswith(self.kept or ("\0",)) and not is_websocket(head):
            self.waiting += 1
            self.most_waiting = max(self.most_waiting, self.waiting)
            await reader.read(1)  # until the browser gives up
            self.waiting -= 1
            return
        for addresses, status, body in ((self.portal, "200 OK", PORTAL), (self.missing, "404 Not Found", "gone")):
            if path.startswith(addresses or ("\0",)):
                about = f"HTTP/1.1 {status}\r\nContent-Type: text/html\r\nContent-Length: {len(body)}\r\n"
                writer.write(f"{about}Connection: close\r\n\r\n{body}".encode())
                await writer.drain()
                return
        await self._pass_on(head, reader, writer)

    async def _pass_on(self, head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there = await asyncio.open_connection("127.0.0.1", self.target)
        if not is_websocket(head):
            # One request for each connection, so that the next one is looked at, too.
            head = head.replace(b"\r\n", b"\r\nConnection: close\r\n", 1).replace(b"Connection: keep-alive\r\n", b"")
        there[1].write(head)
        await asyncio.gather(copy(reader, there[1]), copy(there[0], writer))


def is_websocket(head: bytes) -> bool:
    return b"upgrade: websocket" in head.lower()


async def copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(OSError):
        while data := await reader.read(65536):
            writer.write(data)
            await writer.drain()
    writer.close()


@contextlib.asynccontextmanager
async def proxy_to(port: int) -> AsyncIterator[Proxy]:
    proxy = Proxy(port)
    server = await asyncio.start_server(proxy.serve, "127.0.0.1", proxy.port)
    try:
        yield proxy
    finally:
        server.close()
