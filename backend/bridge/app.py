"""The bridge as one ASGI application: its parts, its routes, and what each request passes first."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.routing import BaseRoute, Route, WebSocketRoute

from backend import tokens
from backend.audit import Audit
from backend.bridge import api, login, token_api
from backend.bridge.acp_socket import AcpSocket
from backend.bridge.connection_limits import SCENE_SOCKETS_PER_PAGE, ConnectionLimit
from backend.bridge.limits import Limits
from backend.bridge.origin import HostGuard, OriginError, OriginPolicy
from backend.bridge.reading_pace import ReadingPace
from backend.bridge.scene.control_socket import CameraMoved, ControlSocket
from backend.bridge.scene.proxy import ScenePage, SceneSocket, redirect_to_slash
from backend.bridge.scene.robot_camera_socket import RobotCameraSocket
from backend.bridge.scene.scene import Scene
from backend.bridge.scene.ticket import SceneTickets
from backend.bridge.stop import RobotStop
from backend.bridge.upstream import agent_at
from backend.bridge.web_app import SecurityHeaders, WebApp
from backend.config import Settings
from backend.robot_server import RobotServerClient
from backend.wrong_logins import WrongLogins

WEB_DIST = Path(__file__).resolve().parents[2] / "web" / "dist"


def create_app(
    settings: Settings, web_dist: Path = WEB_DIST, *, max_pages: int | None = None, limits: Limits | None = None
) -> FastAPI:
    """The bridge for `settings`. Raises `ConfigError` for an agent address that cannot be used.

    `max_pages` may be fewer than the settings allow, where the system has no room for more.
    """
    bridge, limits = settings.bridge, limits or Limits()
    origins = OriginPolicy(bridge.host, bridge.allowed_origins)
    registry = tokens.Registry(settings.data_dir)
    audit = Audit(settings.data_dir, "bridge")
    authenticator = login.Authenticator(registry, origins, WrongLogins(bridge.requests.wrong_logins, audit))
    cookies = login.Cookies(authenticator, settings.data_dir, audit)
    agent = agent_at(settings.agent_address, limits)
    robot = RobotServerClient.of(settings, settings.bridge_robot_base_url)
    health = api.Health(agent, robot, settings.robot.name, limits)
    scene = Scene(settings.robot.name, robot)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        running = (scene.run(), registry.run(), robot.keep_warm())
        background = [asyncio.create_task(work) for work in running]
        try:
            yield
        finally:
            for task in background:
                task.cancel()
            await asyncio.gather(*background, return_exceptions=True)
            await robot.close()
            await asyncio.to_thread(audit.close)

    app = FastAPI(lifespan=lifespan, docs_url=None, redoc_url=None, openapi_url=None)
    app.add_middleware(HostGuard, policy=origins)
    app.add_middleware(SecurityHeaders)
    app.add_exception_handler(login.LoginError, _login_error)
    app.add_exception_handler(OriginError, _error_with_status(403))
    app.add_exception_handler(tokens.RegistryError, _error_with_status(503))
    app.add_exception_handler(HTTPException, _http_error)
    app.add_exception_handler(ClientDisconnect, _client_left)
    app.include_router(login.router(authenticator, cookies, settings.robot.name))
    app.include_router(api.router(authenticator, robot, RobotStop(robot, settings.agent_address), health, audit))
    app.include_router(token_api.router(authenticator, settings.data_dir, audit))
    pages, per_login = max_pages or bridge.max_connections, limits.pages_per_login
    acp_pace = ReadingPace(bridge.requests)
    acp_limit = ConnectionLimit(authenticator, pages, per_login, acp_pace, bridge.max_frame_bytes)
    scene_sockets, per_login = pages * SCENE_SOCKETS_PER_PAGE, per_login * SCENE_SOCKETS_PER_PAGE
    scene_limit = ConnectionLimit(authenticator, scene_sockets, per_login, ReadingPace(bridge.requests))
    acp = AcpSocket(authenticator, agent, max_frame_bytes=bridge.max_frame_bytes, limits=limits)
    app.router.routes.append(WebSocketRoute("/acp", acp_limit.endpoint(acp.serve)))
    tickets = SceneTickets(authenticator, settings.data_dir)
    app.router.routes += scene_routes(authenticator, scene, scene_limit, tickets)
    app.mount("/", WebApp(web_dist))
    return app


def scene_routes(
    authenticator: login.Authenticator, scene: Scene, limit: ConnectionLimit, tickets: SceneTickets
) -> list[BaseRoute]:
    """The scene's page and WebSockets, without and with a viewer's id, and the robot's camera."""
    page = ScenePage(authenticator, scene, tickets).answer
    socket = limit.endpoint(SceneSocket(authenticator, scene).serve, tickets.admit)
    return [
        WebSocketRoute("/camera", limit.endpoint(RobotCameraSocket(authenticator, scene).serve)),
        WebSocketRoute("/scene", socket),
        Route("/scene", redirect_to_slash),
        Route("/scene/", page),
        WebSocketRoute("/scene/{viewer}", socket),
        Route("/scene/{viewer}", redirect_to_slash),
        Route("/scene/{viewer}/", page),
        WebSocketRoute("/scene/{viewer}/control", limit.endpoint(ControlSocket(authenticator, scene).serve)),
        Route("/scene/{viewer}/moved", CameraMoved(tickets, scene).answer, methods=["POST"]),
    ]


def _error_with_status(status: int) -> Any:
    """An exception handler that answers with this status and the exception's sentence."""

    async def answer(_: Request, error: Exception) -> JSONResponse:
        return JSONResponse({"error": str(error)}, status_code=status)

    return answer


async def _login_error(_: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, login.LoginError)  # noqa: S101 - it is registered for this exception
    return error.answer()


async def _client_left(_: Request, __: Exception) -> Response:
    """A client left before its request had arrived: nobody reads this answer, and it is no error of the bridge."""
    return Response(status_code=400)


async def _http_error(_: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)  # noqa: S101 - it is registered for this exception
    sentence = "There is no such address." if error.status_code == 404 else f"{error.detail}."
    return JSONResponse({"error": sentence}, status_code=error.status_code, headers=error.headers)
