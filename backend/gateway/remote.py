"""The connection to the remote robot: a WebSocket with a login token, or TCP.

Messages go in and out as the bytes that they are. Every failure is raised as one sentence that says what to do.
"""

from __future__ import annotations

import logging
import ssl
from http import HTTPStatus
from typing import Self
from urllib.parse import urlsplit

from websockets.exceptions import InvalidStatus, WebSocketException

from backend import addresses, dial, wire
from backend.config import ConfigError, Settings

_LOGIN_ENDED = 4401  # the bridge's own close code
_NEW_TOKEN = "Make a token with `robot-acp token create` and pass it with --token or ROBOT_ACP_TOKEN."  # noqa: S105 - advice

log = logging.getLogger(__name__)


class RemoteError(Exception):
    """The remote cannot be reached, or is lost; the text is for people and says what to do."""


class Address(dial.Address):
    """Where the remote is, and the token to show there."""

    @classmethod
    def parse(cls, url: str, token: str | None) -> Self:
        """Read `ws://HOST/acp`, `wss://HOST/acp` or `tcp://HOST:PORT`. Raises `ConfigError`."""
        try:
            return super().parse(url, token)
        except ValueError:
            expected = "Give wss://HOST/acp, ws://HOST:PORT/acp or tcp://HOST:PORT."
            raise ConfigError(f"{url!r} is no address. {expected}") from None

    @classmethod
    def of_local_bridge(cls, settings: Settings, token: str | None) -> Address:
        """The bridge of these settings, on this machine."""
        host = addresses.reached_at(settings.bridge.host)
        return cls.parse(addresses.url("ws", host, settings.bridge.port, "/acp"), token)

    async def connect(self) -> Remote:
        """Open a connection. Raises `RemoteError`."""
        if self.scheme == "ws" and self.token and not self.is_local:
            log.warning("the login token goes to %s without encryption; use wss:// where you can", self.host)
        try:
            return Remote(self, await dial.dial(self))
        except InvalidStatus as error:
            raise RemoteError(self._refusal(error.response.status_code)) from None
        except ssl.SSLError as error:
            reason = getattr(error, "verify_message", "") or error.reason or "the handshake failed"
            raise RemoteError(f"No safe connection to {self.url}: {reason}. Check its certificate and port.") from None
        except (OSError, TimeoutError):
            advice = "Is the robot running? Start it with `robot-acp up`." if self.is_local else "Is the address right?"
            raise RemoteError(f"Nothing answers at {self.url}. {advice}") from None
        except WebSocketException:
            raise RemoteError(f"{self.url} does not speak WebSocket. Is the address right?") from None

    def _refusal(self, status: int) -> str:
        refused = status in (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN)
        if refused and urlsplit(self.url).path.endswith("/acp"):
            return f"The robot at {self.url} did not accept this login. {_NEW_TOKEN}"
        # A bridge refuses a WebSocket at any other path as it refuses a bad login.
        advice = f" If it is: {_NEW_TOKEN}" if refused else ""
        return (
            f"{self.url} answered with HTTP status {status}. Is it right? The address of a bridge ends in /acp.{advice}"
        )


class Remote:
    """One open connection to the remote."""

    def __init__(self, address: Address, stream: dial.Stream) -> None:
        self._address = address
        self._stream = stream

    async def send(self, frame: wire.Frame) -> None:
        """Pass a message on; waits while the remote is slow. Raises `RemoteError`."""
        message = frame.raw
        if frame.method == "initialize" and self._address.token and self._address.scheme == "tcp":
            message = wire.with_identity(frame, self._address.token)  # TCP has no header that could carry it
        try:
            await self._stream.send(message)
        except dial.Lost as lost:
            raise self._error(lost) from None

    async def receive(self) -> bytes:
        """The next message, on one line, unchecked. Raises `RemoteError` at the end, `BadFrame` for one too large."""
        try:
            return await self._stream.receive()
        except dial.Lost as lost:
            raise self._error(lost) from None

    async def close(self) -> None:
        """End the connection, politely but soon."""
        await self._stream.close()

    def _error(self, lost: dial.Lost) -> RemoteError:
        if lost.too_large:
            size = wire.MAX_FRAME_BYTES
            return RemoteError(
                f"The robot sent a message larger than {size} bytes. Connect again and load the session."
            )
        reason = lost.reason if lost.reason.isprintable() else ""  # it goes to a terminal
        if lost.code == _LOGIN_ENDED:
            return RemoteError(
                f"{reason or 'Your login has ended.'} Pass the new token with --token or ROBOT_ACP_TOKEN."
            )
        quoted = f" ({reason.rstrip('.')})" if reason else ""
        advice = "Check that the robot is running, then connect again."
        return RemoteError(f"The connection to {self._address.url} is lost{quoted}. {advice}")
