"""The client's end of an ACP connection: a stream of messages over TCP or a WebSocket.

A message is the bytes of one JSON text without a newline; they pass unread and unchecked. Over a WebSocket the login
token goes with the handshake. Over TCP there is no place for it: the caller puts it into `initialize`. The callers
also put failures into words for people.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
from dataclasses import dataclass, field
from ipaddress import ip_address
from typing import Protocol, Self
from urllib.parse import SplitResult, urlsplit

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode
from websockets.typing import Subprotocol

from backend import wire
from backend.streams import CLOSE_SECONDS, close

_SUBPROTOCOL = Subprotocol("acp.v1")
_CONNECT_SECONDS = 10.0
_ONE_LINE = bytes.maketrans(b"\r\n", b"  ")


class Lost(Exception):
    """The connection is over. `code` and `reason` are those of the other side's WebSocket close frame, if one came."""

    def __init__(self, code: int | None = None, reason: str = "", *, too_large: bool = False) -> None:
        super().__init__(reason or "the connection is lost")
        self.code = code
        self.reason = reason
        self.too_large = too_large
        """Whether it ended because the other side sent a WebSocket message over `wire.MAX_FRAME_BYTES`."""


class Stream(Protocol):
    """One open connection."""

    async def send(self, message: bytes) -> None:
        """Send a message; waits while the other side is slow. Raises `Lost`."""

    async def receive(self) -> bytes:
        """The next message, on one line. Raises `Lost` at the end; over TCP, `FrameTooLarge` for one that was too
        large and has been skipped."""

    async def close(self) -> None:
        """End the connection, politely but soon."""


@dataclass(frozen=True)
class Address:
    """Where an agent or a bridge is, and the token to show there."""

    url: str
    scheme: str
    """tcp, ws or wss."""
    host: str
    port: int
    token: str | None = field(repr=False)

    @classmethod
    def parse(cls, url: str, token: str | None) -> Self:
        """Read `ws://HOST/acp`, `wss://HOST/acp` or `tcp://HOST:PORT`. Raises `ValueError` for anything else."""
        parts = urlsplit(url)
        port = parts.port
        if parts.hostname and parts.scheme == "tcp" and port:
            return cls(url, "tcp", parts.hostname, port, token)
        if parts.hostname and parts.scheme in ("ws", "wss"):
            full = parts if parts.path else parts._replace(path="/acp")
            return cls(full.geturl(), parts.scheme, parts.hostname, port or _default_port(full), token)
        raise ValueError("no address")

    @property
    def is_local(self) -> bool:
        """Whether it is on this machine."""
        with contextlib.suppress(ValueError):
            return ip_address(self.host).is_loopback
        return self.host == "localhost"


async def dial(address: Address) -> Stream:
    """Connect. Raises `OSError`, `TimeoutError`, and `WebSocketException`, of which `InvalidStatus` is a refusal."""
    if address.scheme == "tcp":
        return await _dial_tcp(address)
    return await _dial_websocket(address)


async def _dial_tcp(address: Address) -> Stream:
    async with asyncio.timeout(_CONNECT_SECONDS):
        reader, writer = await asyncio.open_connection(address.host, address.port, limit=wire.MAX_FRAME_BYTES + 1)
    connected: socket.socket = writer.get_extra_info("socket")
    connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    return _TcpStream(reader, writer)


async def _dial_websocket(address: Address) -> Stream:
    return _WebSocketStream(
        await connect(
            address.url,
            additional_headers={"Authorization": f"Bearer {address.token}"} if address.token else {},
            subprotocols=[_SUBPROTOCOL],
            # A proxy's loopback is not ours; and without TLS it would read the token.
            proxy=None if address.is_local or address.scheme == "ws" else True,
            max_size=wire.MAX_FRAME_BYTES,
            compression=None,
            open_timeout=_CONNECT_SECONDS,
            close_timeout=CLOSE_SECONDS,
        )
    )


def _default_port(parts: SplitResult) -> int:
    return 443 if parts.scheme == "wss" else 80


class _TcpStream:
    """One message a line."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._writer = writer

    async def send(self, message: bytes) -> None:
        self._writer.write(message + b"\n")
        try:
            await self._writer.drain()
        except OSError:
            raise Lost from None

    async def receive(self) -> bytes:
        try:
            line = await wire.read_line(self._reader)
        except OSError:
            line = None
        if line is None:
            self._writer.close()  # an agent that ended its half reads the other one no longer
            raise Lost
        return line

    async def close(self) -> None:
        await close(self._writer)


class _WebSocketStream:
    """One message a frame."""

    def __init__(self, websocket: ClientConnection) -> None:
        self._websocket = websocket

    async def send(self, message: bytes) -> None:
        try:
            await self._websocket.send(message, text=True)
        except ConnectionClosed as closed:
            raise _lost(closed) from None

    async def receive(self) -> bytes:
        try:
            message = await self._websocket.recv(decode=False)
        except ConnectionClosed as closed:
            raise _lost(closed) from None
        # Line ends are white space here, as JSON strings hold neither byte. Left in, they would end the line too early.
        return message.translate(_ONE_LINE).strip()

    async def close(self) -> None:
        await self._websocket.close()


def _lost(closed: ConnectionClosed) -> Lost:
    if closed.sent is not None and closed.sent.code == CloseCode.MESSAGE_TOO_BIG:
        return Lost(too_large=True)
    return Lost(closed.rcvd.code, closed.rcvd.reason) if closed.rcvd else Lost()
