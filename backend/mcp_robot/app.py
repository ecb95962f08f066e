"""The robot server's HTTP: MCP, telemetry, stop and health, behind one access check.

Routes only; what they do is elsewhere. Stop must work whatever the request looks like: a stop is never refused for its
form.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from typing import Any

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


def create_app(pilot: Pilot, tools: RobotServer, token: bytes, host: str) -> Starlette:
    """The ASGI application of one robot."""
    stream = TelemetryStream(pilot)

    async def health(request: Request) -> JSONResponse:
        return JSONResponse({"status": "ok", "robot": pilot.robot.name, "version": __version__})

    async def stop(request: Request) -> JSONResponse:
        pilot.brake()  # before the body, which may be slow to come
        latched = pilot.stop(name_of(await _said_by(request)))
        return JSONResponse({"stopped": {"by": latched.by, "at": latched.at}})

    async def release(request: Request) -> JSONResponse:
        pilot.release(name_of(await _said_by(request)))
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
    with contextlib.suppress(ValueError, TimeoutError, ClientDisconnect):
        async with asyncio.timeout(BODY_TIME):
            body = await request.json()
        return body.get("by") if isinstance(body, dict) else None
    return None
