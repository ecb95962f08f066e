"""The robot server's HTTP: MCP, telemetry, stop and health, behind one access check.

Routes only; what they do is elsewhere. Stop has to work whatever the request looks like: it is never refused for its
form and never waits for its body. The name of the person who pressed it is in the body, or in the query, which arrives
with the first line of the request: a name that comes with the body is set after the robot has stopped.
"""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator

from mcp.server.transport_security import TransportSecuritySettings
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.routing import Route, WebSocketRoute

from backend import __version__
from backend.audit import Audit
from backend.mcp_robot.http.access import Access
from backend.mcp_robot.http.name_in_body import name_in_body
from backend.mcp_robot.http.telemetry_stream import TelemetryStream
from backend.mcp_robot.motion.pilot import Pilot
from backend.mcp_robot.motion.stop import name_of
from backend.mcp_robot.tools.mcp_server import RobotServer


def create_app(pilot: Pilot, tools: RobotServer, token: bytes, host: str, audit: Audit) -> Starlette:
    """The ASGI application of one robot. `audit` is told who stops and releases it."""
    stream = TelemetryStream(pilot)

    async def health(request: Request) -> JSONResponse:
        return JSONResponse({"status": "ok", "robot": pilot.robot.name, "version": __version__})

    async def stop(request: Request) -> JSONResponse:
        by = request.query_params.get("by")
        is_first = pilot.stopped is None
        latched = pilot.stop(name_of(by))
        pressed_by = name_of(by)
        if is_first and not by:
            pressed_by = name_of(await name_in_body(request))
            latched = pilot.name_stop(latched, pressed_by)
        audit.record("stop", pressed_by, via="HTTP")
        return JSONResponse({"stopped": {"by": latched.by, "at": latched.at}})

    async def release(request: Request) -> JSONResponse:
        by = name_of(request.query_params.get("by") or await name_in_body(request))
        try:
            pilot.release(by)
        except OSError:
            sentence = "The stop cannot be released: its file in the data folder cannot be removed."
            return JSONResponse({"error": sentence}, 500)
        audit.record("release", by, via="HTTP")
        return JSONResponse({"stopped": None})

    async def forget_preview(request: Request) -> JSONResponse:
        return JSONResponse({"preview": pilot.forget_preview(request.path_params["id"])})

    # The SDK's own check of Host and Origin knows only loopback addresses; `Access` has checked them already.
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
            Route("/preview/{id}", forget_preview, methods=["DELETE"]),
            WebSocketRoute("/telemetry", stream.serve),
            *mcp.routes,
        ],
        middleware=[Middleware(Access, token=token, host=host)],
        lifespan=lifespan,
    )
