"""uvicorn's HTTP protocol with limits for strangers: time for headers and body, and a number of connections.

uvicorn waits for ever for headers and bodies. Here a connection that does not send them in time is closed, and beyond
`ConnectionsBeforeLogin` the oldest connection is: so a new one always gets in, and Stop has a way that is never full.

It builds on a class of uvicorn that is not public API: `pyproject.toml` pins uvicorn's minor version.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from backend.connections_before_login import ConnectionsBeforeLogin, Use

BACKLOG = 100
"""So many connections are accepted at once, before the oldest of those that are too many are closed."""
MAX_HEADER_BYTES = 16 * 1024
"""h11 takes 10 ms for so many, in lines of the smallest size."""
_READ_BYTES = 4096
"""So much is read at a time. h11 parses headers that are complete however long they are, and 256 kB took 0.1 s."""
LOGGED_IN = "robot-acp.logged-in"
"""ASGI scope key that an app sets when a request came with a valid login."""
STOP_PATHS = frozenset({"/stop", "/api/stop"})


@dataclass(frozen=True)
class HttpLimits:
    """Times are in s. `connections` has every connection until it is an admitted WebSocket."""

    connections: ConnectionsBeforeLogin
    header_seconds: float = 10.0
    body_seconds: float = 30.0


def http_protocol(limits: HttpLimits) -> type[HttpProtocol]:
    """The class for `uvicorn.Config(http=…)`."""

    class Limited(HttpProtocol):
        _limits = limits

    return Limited


class HttpProtocol(H11Protocol):
    """One connection, with requests one after the other."""

    _limits: HttpLimits
    _awaited: str | None = None  # what the client has to send next: "headers", "body", None for nothing
    _timer: asyncio.TimerHandle | None = None
    _is_known = False  # whether a request came with a valid login

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Count the connection, and wait for its first request."""
        super().connection_made(transport)
        if hasattr(transport, "max_size"):
            transport.max_size = _READ_BYTES  # of asyncio's transports
        self._limits.connections.add(transport, self.client[0] if self.client else None, transport.abort)
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """Count it no more."""
        self._limits.connections.remove(self.transport)
        self._stop_timer()
        super().connection_lost(exc)

    def handle_events(self) -> None:
        """Handle what has arrived."""
        super().handle_events()
        if self.transport.get_protocol() is self:
            self._watch()

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        super().on_response_complete()
        self._is_known = self._is_known or LOGGED_IN in self.scope
        self._watch()

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Hand the connection to the WebSocket protocol, which counts it on if it wants to."""
        self._stop_timer()
        self._limits.connections.remove(self.transport)
        super().handle_websocket_upgrade(event)

    def _watch(self) -> None:
        """Note what the client has to send next, and begin the time for it where that has changed."""
        is_answering = self.cycle is not None and not self.cycle.response_complete
        use = Use.ANSWERING if is_answering else Use.KNOWN if self._is_known else Use.WAITING
        if is_answering and self.scope["path"] in STOP_PATHS and self.scope["method"] == "POST":
            use = Use.STOPPING
        self._limits.connections.set_use(self.transport, use)
        awaited = {h11.IDLE: "headers", h11.SEND_BODY: "body"}.get(self.conn.their_state)
        if awaited == "headers" and is_answering:
            awaited = None
        if awaited == self._awaited:
            return
        self._stop_timer()
        self._awaited = awaited
        if awaited is not None:
            seconds = self._limits.header_seconds if awaited == "headers" else self._limits.body_seconds
            self._timer = self.loop.call_later(seconds, self.transport.abort)

    def _stop_timer(self) -> None:
        self._awaited = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


def uvicorn_options(limits: HttpLimits) -> dict[str, Any]:
    """The options of `uvicorn.Config` that put `limits` into force."""
    return {
        "http": http_protocol(limits),
        "backlog": BACKLOG,
        "h11_max_incomplete_event_size": MAX_HEADER_BYTES,
    }
