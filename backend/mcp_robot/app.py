"""The robot server's HTTP: MCP, telemetry, stop and health, behind one access check.

Routes only; what they do is elsewhere. Stop must work whatever the request looks like: a stop is never refused for its
form.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from typing import Any

import orjson
from mcp.server.transport_security import TransportSecuritySettings
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse
from starlette.routing import Route, WebSocketRoute

from backend import __version__
from backend.mcp_robot.access import Access
from backend.mcp_robot.pilot import Pilot
from backend.mcp_robot.stop import name_of
from backend.mcp_robot.telemetry_stream import TelemetryStream
from backend.mcp_robot.tools import RobotServer

BODY_TIME = 1.0
"""Seconds that the name of whoever pressed stop may take to arrive."""
MAX_BODY = 4096
"""Bytes in which it fits."""


def create_app(pilot: Pilot, tools: RobotServer, token: bytes, host: str) -> Starlette:
    """The ASGI application of one robot."""
    stream = TelemetryStream(pilot)

    async def health(request: Request) -> JSONResponse:
        return JSONResponse({"status": "ok", "robot": pilot.robot.name, "version": __version__})

    async def stop(request: Request) -> JSONResponse:
        first = pilot.stopped is None
        latched = pilot.stop(name_of(None))  # before the body, which may be slow to come, or no good
        if (by := await _said_by(request)) is not None and first:
            latched = pilot.name_stop(latched, name_of(by))
        return JSONResponse({"stopped": {"by": latched.by, "at": latched.at}})

    async def release(request: Request) -> JSONResponse:
        try:
            pilot.release(name_of(await _said_by(request)))
        except OSError:
            sentence = "The stop cannot be released: its file in the data folder cannot be removed."
            return JSONResponse({"error": sentence}, 500)
        return JSONResponse({"stopped": None})

    # Access has checked Host and Origin already, and for more than loopback.
    security = TransportSecuritySettings(enable_dns_rebinding_protection=False)
    mcp = tools.streamable_http_app(transport_security=security, host=host)

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        async with tools.session_manager.run():
            yield

    return Starlette(
        routes=[
            Route("/health", health),
            Route("/stop", stop, methods=["POST"]),
            Route("/release", release, methods=["POST"]),
            WebSocketRoute("/telemetry", stream.serve),
            *mcp.routes,
        ],
        middleware=[Middleware(Access, token=token, host=host)],
        lifespan=lifespan,
    )


async def _said_by(request: Request) -> Any:
    """The `by` of a JSON body, None when there is none, or none comes in time."""
    body = b""
    with contextlib.suppress(TimeoutError, ClientDisconnect, orjson.JSONDecodeError):
        async with asyncio.timeout(BODY_TIME):
            async for piece in request.stream():
                body += piece
                if len(body) > MAX_BODY:
                    return None
        said = orjson.loads(body)
        return said.get("by") if isinstance(said, dict) else None
    return None
