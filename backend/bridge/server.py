"""The bridge process: one socket, one HTTP and WebSocket server, from start to a clean end."""

from __future__ import annotations

import asyncio
import logging
import socket

import uvicorn

from backend.bridge import door
from backend.bridge.app import create_app
from backend.bridge.direct import DirectWebSocket
from backend.config import ConfigError, Settings
from backend.descriptors import raise_limit

PING_SECONDS = 5.0
PONG_SECONDS = 15.0
"""Longer than a ping may wait behind a large message on a slow link. Until then whoever is gone counts as there."""
_END_SECONDS = 3

log = logging.getLogger(__name__)


async def serve(settings: Settings, *, listener: socket.socket | None = None) -> None:
    """Serve until cancelled, or until SIGINT or SIGTERM. Raises `ConfigError` when the address cannot be had.

    `listener` is a socket that is bound already; without it, `bridge.host` and `bridge.port` say where.
    """
    for noisy in ("httpx", "websockets"):  # a line for every health check is a log that nobody reads
        logging.getLogger(noisy).setLevel(logging.WARNING)
    wanted = settings.bridge.max_connections
    descriptors = raise_limit(wanted * door.DESCRIPTORS_A_PAGE + door.DESCRIPTORS_KEPT)
    app = create_app(settings, max_pages=door.pages_for(descriptors, wanted))
    bound = listener or listen(settings)
    host, port = bound.getsockname()[:2]
    server = uvicorn.Server(
        uvicorn.Config(
            app,
            ws=DirectWebSocket,
            ws_max_size=settings.bridge.max_frame_bytes,
            ws_ping_interval=PING_SECONDS,
            ws_ping_timeout=PONG_SECONDS,
            ws_per_message_deflate=False,  # costs more time than a local network needs for these sizes
            lifespan="on",
            log_config=None,
            log_level="warning",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=_END_SECONDS,
        )
    )
    log.info("bridge on http://%s:%s, agent at %s", host, port, settings.agent_address)
    serving = asyncio.ensure_future(server.serve(sockets=[bound]))
    try:
        await asyncio.shield(serving)
    except asyncio.CancelledError:
        server.should_exit = True
        await serving
        raise


def listen(settings: Settings) -> socket.socket:
    """The bridge's listening socket. Raises `ConfigError`."""
    host, port = settings.bridge.host, settings.bridge.port
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        bound = socket.create_server((host, port), family=family, backlog=512)
    except OSError as error:
        raise ConfigError(f"The bridge cannot listen on {host}:{port}: {error.strerror}.") from None
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        # Accepted connections inherit it: a peer that no longer reads is cut off in the end.
        bound.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 30_000)
    return bound
