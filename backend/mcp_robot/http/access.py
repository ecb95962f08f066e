"""Who may use the robot's HTTP server: processes that have its token, under its own address, and no web page.

An ASGI middleware in front of every route but `/health`. A loopback address is no protection against the web: a page in
a local browser can reach any local port. So Host and Origin are checked besides the token, against DNS rebinding and
cross-site requests.
"""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import socket

from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from backend.mcp_robot.tools.long_call import CLIENT_GONE

PUBLIC = frozenset({"/health"})


class Access:
    """Passes a request on, or answers it with 401 (token), 403 (Origin) or 421 (Host) and a sentence."""

    def __init__(self, app: ASGIApp, token: bytes, host: str) -> None:
        if not token:
            raise ValueError("without a token, everybody would be let in")
        self._app = app
        self._token = token
        self._names = own_names(host)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request or WebSocket."""
        if scope["type"] == "lifespan" or scope.get("path") in PUBLIC:
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(Headers(scope=scope))
        if refusal is None:
            await self._app(*_watched(scope, receive), send)
        else:
            await refusal(scope, receive, send)

    def _refusal(self, headers: Headers) -> JSONResponse | None:
        host = headers.get("host", "")
        if not self._own(host):
            return _answer(421, "This address does not belong to the robot server.")
        origin = headers.get("origin")
        if origin is not None and origin not in (f"http://{host}", f"https://{host}"):
            return _answer(403, "Web pages of other origins may not talk to the robot server.")
        scheme, _, given = headers.get("authorization", "").partition(" ")
        if scheme.lower() != "bearer" or not hmac.compare_digest(given.strip().encode(), self._token):
            return _answer(401, "The robot server wants the bearer token of its data folder (robot.token).")
        return None

    def _own(self, host: str) -> bool:
        name = host.rpartition(":")[0] if not host.endswith("]") and ":" in host else host
        name = name.strip("[]").lower()
        return name in self._names or ("*" in self._names and _is_address(name))


def own_names(host: str) -> frozenset[str]:
    """The host names of a server that is bound to `host`; "*" stands for any IP address. A wildcard address adds this
    machine's name and "*": DNS rebinding needs a name, so a Host that is an address cannot come from it."""
    local = {"localhost", "127.0.0.1", "::1"}
    if host in ("", "0.0.0.0", "::"):  # noqa: S104 - compared, not bound
        return frozenset(local | {socket.gethostname().lower(), "*"})
    return frozenset(local | {host.lower()})


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _answer(status: int, sentence: str) -> JSONResponse:
    headers = {"www-authenticate": "Bearer"} if status == 401 else None
    return JSONResponse({"error": sentence}, status, headers)


def _watched(scope: Scope, receive: Receive) -> tuple[Scope, Receive]:
    """The same HTTP request with an event in its scope (CLIENT_GONE) that is set when the client hangs up."""
    if scope["type"] != "http":
        return scope, receive
    gone = asyncio.Event()

    async def watching() -> Message:
        message = await receive()
        if message["type"] == "http.disconnect":
            gone.set()
        return message

    return {**scope, CLIENT_GONE: gone}, watching
