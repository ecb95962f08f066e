"""The connection to the remote robot: a WebSocket with a login token, or TCP.

Messages go in and out as the bytes that they are. Whatever goes wrong comes out as one sentence that says what to do.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import ssl
from dataclasses import dataclass, field
from http import HTTPStatus
from ipaddress import ip_address
from typing import Protocol
from urllib.parse import SplitResult, urlsplit

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException
from websockets.frames import CloseCode
from websockets.typing import Subprotocol

from backend import wire
from backend.config import ConfigError, Settings
from backend.gateway.closing import CLOSE_SECONDS, close

_SUBPROTOCOL = Subprotocol("acp.v1")
_LOGIN_ENDED = 4401  # the bridge's own close code
_CONNECT_SECONDS = 10.0
_ONE_LINE = bytes.maketrans(b"\r\n", b"  ")
_NEW_TOKEN = "Make a token with `robot-acp token create` and pass it with --token or ROBOT_ACP_TOKEN."  # noqa: S105 - advice

log = logging.getLogger(__name__)


class RemoteError(Exception):
    """The remote cannot be reached, or is lost; the text is for people and says what to do."""


class Remote(Protocol):
    """One open connection to the remote."""

    async def send(self, frame: wire.Frame) -> None:
        """Pass a message on; waits while the remote is slow. Raises `RemoteError`."""

    async def receive(self) -> bytes:
        """The next message, on one line, unchecked. Raises `RemoteError` at the end, `BadFrame` for one too large."""

    async def close(self) -> None:
        """End the connection, politely but soon."""


@dataclass(frozen=True)
class Address:
    """Where the remote is, and the token to show there."""

    url: str
    scheme: str
    """tcp, ws or wss."""
    host: str
    port: int
    token: str | None = field(repr=False)

    @classmethod
    def parse(cls, url: str, token: str | None) -> Address:
        """Read `ws://HOST/acp`, `wss://HOST/acp` or `tcp://HOST:PORT`. Raises `ConfigError`."""
        problem = ConfigError(f"{url!r} is no address. Give wss://HOST/acp, ws://HOST:PORT/acp or tcp://HOST:PORT.")
        try:
            parts = urlsplit(url)
            port = parts.port
        except ValueError:
            raise problem from None
        if parts.hostname and parts.scheme == "tcp" and port:
            return cls(url, "tcp", parts.hostname, port, token)
        if parts.hostname and parts.scheme in ("ws", "wss"):
            full = parts if parts.path else parts._replace(path="/acp")
            return cls(full.geturl(), parts.scheme, parts.hostname, port or _default_port(full), token)
        raise problem

    @classmethod
    def of_local_bridge(cls, settings: Settings, token: str | None) -> Address:
        """The bridge of these settings, on this machine."""
        host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(settings.bridge.host, settings.bridge.host)  # noqa: S104
        return cls.parse(f"ws://{f'[{host}]' if ':' in host else host}:{settings.bridge.port}/acp", token)

    @property
    def is_local(self) -> bool:
        """Whether it is on this machine."""
        with contextlib.suppress(ValueError):
            return ip_address(self.host).is_loopback
        return self.host == "localhost"

    async def connect(self) -> Remote:
        """Open a connection. Raises `RemoteError`."""
        try:
            return await (self._tcp() if self.scheme == "tcp" else self._websocket())
        except InvalidStatus as error:
            raise RemoteError(self._refusal(error.response.status_code)) from None
        except ssl.SSLError as error:
            reason = getattr(error, "verify_message", "") or error.reason or "the handshake failed"
            raise RemoteError(f"No safe connection to {self.url}: {reason}. Check its certificate and port.") from None
        except (OSError, TimeoutError):
            what = "Is the robot running? Start it with `robot-acp up`." if self.is_local else "Is the address right?"
            raise RemoteError(f"Nothing answers at {self.url}. {what}") from None
        except WebSocketException:
            raise RemoteError(f"{self.url} does not speak WebSocket. Is the address right?") from None

    async def _tcp(self) -> Remote:
        async with asyncio.timeout(_CONNECT_SECONDS):
            reader, writer = await asyncio.open_connection(self.host, self.port, limit=wire.MAX_FRAME_BYTES + 1)
        connected: socket.socket = writer.get_extra_info("socket")
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        return _Lines(self, reader, writer)

    async def _websocket(self) -> Remote:
        if self.scheme == "ws" and self.token and not self.is_local:
            log.warning("the login token goes to %s without encryption; use wss:// where you can", self.host)
        return _Frames(
            self,
            await connect(
                self.url,
                additional_headers={"Authorization": f"Bearer {self.token}"} if self.token else {},
                subprotocols=[_SUBPROTOCOL],
                proxy=None if self.is_local else True,  # a proxy's loopback is not ours
                max_size=wire.MAX_FRAME_BYTES,
                compression=None,
                open_timeout=_CONNECT_SECONDS,
                close_timeout=CLOSE_SECONDS,
            ),
        )

    def _refusal(self, status: int) -> str:
        refused = status in (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN)
        if refused and urlsplit(self.url).path.endswith("/acp"):
            return f"The robot at {self.url} did not accept this login. {_NEW_TOKEN}"
        # A bridge refuses a WebSocket anywhere else as it refuses a bad login.
        advice = f" If it is: {_NEW_TOKEN}" if refused else ""
        return (
            f"{self.url} answered with HTTP status {status}. Is it right? The address of a bridge ends in /acp.{advice}"
        )

    def lost(self, closed: ConnectionClosed | None = None) -> RemoteError:
        """Why an open connection is over."""
        if closed is not None and closed.sent is not None and closed.sent.code == CloseCode.MESSAGE_TOO_BIG:
            size = wire.MAX_FRAME_BYTES
            return RemoteError(
                f"The robot sent a message larger than {size} bytes. Connect again and load the session."
            )
        code, reason = (closed.rcvd.code, closed.rcvd.reason) if closed is not None and closed.rcvd else (None, "")
        if not reason.isprintable():
            reason = ""  # it goes to a terminal
        if code == _LOGIN_ENDED:
            return RemoteError(
                f"{reason or 'Your login has ended.'} Pass the new token with --token or ROBOT_ACP_TOKEN."
            )
        told = f" ({reason.rstrip('.')})" if reason else ""
        advice = "Check that the robot is running, then connect again."
        return RemoteError(f"The connection to {self.url} is lost{told}. {advice}")


def _default_port(parts: SplitResult) -> int:
    return 443 if parts.scheme == "wss" else 80


class _Lines:
    """TCP: one message a line."""

    def __init__(self, address: Address, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._address = address
        self._reader = reader
        self._writer = writer

    async def send(self, frame: wire.Frame) -> None:
        line = frame.raw
        if frame.method == "initialize" and self._address.token:
            line = wire.with_identity(frame, self._address.token)  # TCP has no header that could carry it
        self._writer.write(line + b"\n")
        try:
            await self._writer.drain()
        except OSError:
            raise self._address.lost() from None

    async def receive(self) -> bytes:
        try:
            line = await wire.read_line(self._reader)
        except OSError:
            line = None
        if line is None:
            raise self._address.lost()
        return line

    async def close(self) -> None:
        await close(self._writer)


class _Frames:
    """WebSocket: one message a frame."""

    def __init__(self, address: Address, websocket: ClientConnection) -> None:
        self._address = address
        self._websocket = websocket

    async def send(self, frame: wire.Frame) -> None:
        try:
            await self._websocket.send(frame.raw, text=True)
        except ConnectionClosed as closed:
            raise self._address.lost(closed) from None

    async def receive(self) -> bytes:
        try:
            message = await self._websocket.recv(decode=False)
        except ConnectionClosed as closed:
            raise self._address.lost(closed) from None
        # White space, as JSON strings hold neither byte; left in, it would end the line too early.
        return message.translate(_ONE_LINE).strip()

    async def close(self) -> None:
        await self._websocket.close()
