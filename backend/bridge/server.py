"""The bridge process: one HTTP and WebSocket server on one socket, from its start to its orderly end."""

from __future__ import annotations

import asyncio
import logging
import socket

import uvicorn

from backend import addresses, collector, exposure
from backend.bridge.app import create_app
from backend.bridge.connection_limits import (
    DESCRIPTORS_PER_PAGE,
    RESERVED_DESCRIPTORS,
    max_before_login_for,
    max_pages_for,
)
from backend.bridge.limits import Limits
from backend.bridge.websocket_protocol import websocket_protocol
from backend.config import ConfigError, Settings
from backend.connections_before_login import ConnectionsBeforeLogin
from backend.descriptors import raise_limit
from backend.http_protocol import BACKLOG, HttpLimits, uvicorn_options

PING_SECONDS = 5.0
PONG_SECONDS = 15.0
"""Longer than a ping may wait behind a large message on a slow link. Until then a lost client counts as connected."""
_SHUTDOWN_SECONDS = 3

log = logging.getLogger(__name__)


async def serve(settings: Settings, *, listener: socket.socket | None = None, limits: Limits | None = None) -> None:
    """Serve until cancelled, or until SIGINT or SIGTERM. Raises `ConfigError` when the address cannot be used.

    `listener` is a bound socket; without it, the bridge binds `bridge.host` and `bridge.port`.
    """
    for name in ("httpx", "websockets"):  # they log a line for every health check
        logging.getLogger(name).setLevel(logging.WARNING)
    wanted, most = settings.bridge.max_connections, settings.bridge.requests
    descriptors = raise_limit(wanted * DESCRIPTORS_PER_PAGE + most.max_before_login + BACKLOG + RESERVED_DESCRIPTORS)
    strangers = max_before_login_for(descriptors, most.max_before_login)
    before_login = ConnectionsBeforeLogin(strangers, most.max_before_login_per_address)
    app = create_app(settings, max_pages=max_pages_for(descriptors, wanted, strangers), limits=limits)
    exposure.warn(settings, "bridge", log)
    bound = listener or listen(settings)
    host, port = bound.getsockname()[:2]
    server = uvicorn.Server(
        uvicorn.Config(
            app,
            **uvicorn_options(HttpLimits(before_login, most.header_timeout, most.body_timeout)),
            ws=websocket_protocol(before_login),
            ws_max_size=settings.bridge.max_frame_bytes,
            ws_ping_interval=PING_SECONDS,
            ws_ping_timeout=PONG_SECONDS,
            ws_per_message_deflate=False,  # on a local network, compressing takes longer than sending
            lifespan="on",
            log_config=None,
            log_level="warning",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=_SHUTDOWN_SECONDS,
        )
    )
    log.info("bridge on %s, agent at %s", addresses.url("http", host, port), settings.agent_address)
    collector.spare_program()
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
    try:
        bound = socket.create_server((host, port), family=addresses.family(host), backlog=512)
    except OSError as error:
        where = addresses.authority(host, port)
        raise ConfigError(f"The bridge cannot listen on {where}: {error.strerror}.") from None
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        # Accepted connections inherit it: the kernel ends one whose peer acknowledges nothing for 30 s.
        bound.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 30_000)
    return bound
