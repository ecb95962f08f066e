"""Who may connect to viser's own port: the proxy of this process, which knows a secret, and nobody else.

viser answers everybody who reaches its port, any web page in a browser of this machine included: with map and pose, and
with a tunnel to the internet for whoever asks. So a request without the secret is refused, for the page as for the
WebSocket, and viser forgets what it does for pages that ask. Like `viser_internals` this rests on the inside of one
version, and `tests/bridge/test_viser_port.py` fails when viser changes it.
"""

from __future__ import annotations

import asyncio
import hmac
import secrets
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import websockets.asyncio.server
import websockets.datastructures
import websockets.exceptions
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request

from backend.connections_before_login import ConnectionsBeforeLogin

if TYPE_CHECKING:
    import viser

_HEADER = "X-Robot-Acp-Viser"
_SECRET = secrets.token_urlsafe(32)
SECRET_HEADERS = {_HEADER: _SECRET}
"""What the proxy sends with each request to viser. It lives as long as this process and is told to nobody."""
_MAX_BEFORE_SECRET = 64
"""Connections without the secret; beyond it the oldest is closed."""


def require_secret() -> None:
    """Let every viser server that is started from now on require the secret. Imports viser, which takes a second."""
    from viser.infra import _infra

    # viser calls `websockets.asyncio.server.serve` and offers no way to add a check. Only viser's own name is replaced.
    _infra.websockets = SimpleNamespace(
        asyncio=SimpleNamespace(server=SimpleNamespace(serve=_serve, ServerConnection=ServerConnection)),
        datastructures=websockets.datastructures,
        exceptions=websockets.exceptions,
    )


def forget_page_requests(server: viser.ViserServer) -> None:
    """Remove all that viser does for a page that asks: to open a tunnel, to change the panel, to take a file."""
    server._websock_server._incoming_handlers.clear()


def _serve(*arguments: Any, process_request: Any = None, **options: Any) -> websockets.asyncio.server.serve:
    """`websockets.asyncio.server.serve` that answers nobody without the secret."""
    strangers = ConnectionsBeforeLogin(_MAX_BEFORE_SECRET, _MAX_BEFORE_SECRET)

    class Connection(ServerConnection):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            super().connection_made(transport)
            strangers.add(self, None, self.transport.abort)

        def connection_lost(self, exc: Exception | None) -> None:
            strangers.remove(self)
            super().connection_lost(exc)

    def check(connection: ServerConnection, request: Request) -> Any:
        given = request.headers.get_all(_HEADER)
        if len(given) != 1 or not hmac.compare_digest(given[0].encode(), _SECRET.encode()):
            return connection.respond(403, "This port belongs to the robot's bridge.\n")
        strangers.remove(connection)
        return process_request(connection, request) if process_request else None

    return websockets.asyncio.server.serve(*arguments, process_request=check, create_connection=Connection, **options)
