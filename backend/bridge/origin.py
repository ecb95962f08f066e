"""Which Host headers this server accepts, and which web pages may send it requests.

A page of another site can reach any server of the local network through its visitor's browser, and can make a name of
its own point to it (DNS rebinding). So the Host must be an IP address or a name of this server, and the Origin must be
this server or one that the settings allow. A valid login must never weaken these checks.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Iterable
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket

_DEFAULT_PORTS = {"http": 80, "https": 443, "ws": 80, "wss": 443}
_SCHEME_OF = {"ws": "http", "wss": "https"}


class OriginError(Exception):
    """The request comes from a page of another site; the text says how to allow that site."""


class OriginPolicy:
    """Which Host and Origin headers are accepted.

    `host` is the address that the server listens on. `allowed` are further origins, such as `https://robot.example.org`
    where a reverse proxy passes requests on.
    """

    def __init__(self, host: str, allowed: Iterable[str] = ()) -> None:
        self._allowed = {origin for item in allowed if (origin := _normal(item))}
        names = {"localhost", host, socket.gethostname(), f"{socket.gethostname()}.local"}
        self._names = {name.lower() for name in names} | {name for _, name, _ in self._allowed}

    def knows_host(self, host: str | None) -> bool:
        """Whether a Host header is accepted. An IP address always is: only a name can be rebound."""
        try:
            name = urlsplit(f"//{host or ''}").hostname
        except ValueError:
            return False
        if not name:
            return False
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return name in self._names or name.endswith(".localhost")
        return True

    def check(self, connection: HTTPConnection, *, explicit_token: bool) -> None:
        """Check that a request comes from a page of this server or of an allowed origin, or from no page at all.

        A browser sends an Origin with every POST and WebSocket. So a request without one counts as a program's only
        when it has a token that no browser adds by itself (`explicit_token`). Raises `OriginError`.
        """
        origin = connection.headers.get("origin")
        if origin is None:
            if explicit_token:
                return
            raise OriginError("A request without an Origin has to bring its login token itself.")
        scheme = _SCHEME_OF.get(connection.scope["scheme"], connection.scope["scheme"])
        own = _normal(f"{scheme}://{connection.headers.get('host', '')}")
        given = _normal(origin)
        if given is None or (given != own and given not in self._allowed):
            raise OriginError(
                f"Pages of {origin[:80]} may not use this robot. Add the address to bridge.allowed_origins to allow it."
            )


def _normal(origin: str) -> tuple[str, str, int] | None:
    """Scheme, host and port of an origin; None for a text that is no origin, and for the opaque origin `null`."""
    try:
        parts = urlsplit(origin.strip().lower())
        port = parts.port or _DEFAULT_PORTS.get(parts.scheme)
    except ValueError:
        return None
    if not parts.scheme or not parts.hostname or port is None:
        return None
    return parts.scheme, parts.hostname, port


class HostGuard:
    """ASGI middleware that refuses requests with an unknown Host before anything else handles them."""

    def __init__(self, app: ASGIApp, policy: OriginPolicy) -> None:
        self._app = app
        self._policy = policy

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer 421."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        if self._policy.knows_host(Headers(scope=scope).get("host")):
            await self._app(scope, receive, send)
            return
        refusal = JSONResponse(
            {
                "error": "This server does not answer to that name. "
                "Use its address, or add the name to bridge.allowed_origins."
            },
            status_code=421,
        )
        if scope["type"] == "websocket":
            websocket = WebSocket(scope, receive, send)
            await websocket.receive()
            await websocket.send_denial_response(refusal)
        else:
            await refusal(scope, receive, send)
