"""The bridge as one ASGI application: what it is made of, and in which order a request meets it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from fastapi import FastAPI, Request
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.routing import BaseRoute, Route, WebSocketRoute

from backend import identity, tokens
from backend.bridge import api, door, login
from backend.bridge.acp_socket import AcpSocket
from backend.bridge.door import Door
from backend.bridge.origin import HostGuard, OriginError, OriginPolicy
from backend.bridge.pages import SecurityHeaders, WebApp
from backend.bridge.robot_link import RobotLink
from backend.bridge.scene.camera_socket import CameraSocket
from backend.bridge.scene.control import CameraMoved, SceneControl
from backend.bridge.scene.proxy import ScenePage, SceneSocket, with_slash
from backend.bridge.scene.scene import Scene
from backend.bridge.upstream import agent_at
from backend.config import Settings

WEB_DIST = Path(__file__).resolve().parents[2] / "web" / "dist"


def create_app(settings: Settings, web_dist: Path = WEB_DIST, *, max_pages: int | None = None) -> FastAPI:
    """The bridge for `settings`. Raises `ConfigError` for an agent address that cannot be.

    `max_pages` may be fewer than the settings allow, for a system that has not room for them.
    """
    bridge = settings.bridge
    origins = OriginPolicy(bridge.host, bridge.allowed_origins)
    registry = tokens.Registry(settings.data_dir)
    gate = login.Gate(registry, origins)
    agent = agent_at(settings.agent_address)
    robot_secret = identity.shared_secret(settings.data_dir, identity.ROBOT_TOKEN)
    robot = RobotLink(settings.robot_base_url, robot_secret)
    health = api.Health(agent, robot, settings.robot.name)
    telemetry_url = settings.robot_base_url.replace("http", "ws", 1) + "/telemetry"
    scene = Scene(settings.robot.name, telemetry_url, robot_secret)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        background = [asyncio.create_task(scene.run()), asyncio.create_task(registry.run())]
        try:
            yield
        finally:
            for task in background:
                task.cancel()
            await asyncio.gather(*background, return_exceptions=True)
            await robot.close()

    app = FastAPI(lifespan=lifespan, docs_url=None, redoc_url=None, openapi_url=None)
    app.add_middleware(HostGuard, policy=origins)
    app.add_middleware(SecurityHeaders)
    app.add_exception_handler(login.LoginError, _says(401))
    app.add_exception_handler(OriginError, _says(403))
    app.add_exception_handler(tokens.RegistryError, _says(503))
    app.add_exception_handler(HTTPException, _http_error)
    app.include_router(login.router(gate, settings.robot.name))
    app.include_router(api.router(gate, robot, health))
    pages, each = max_pages or bridge.max_connections, door.PAGES_A_LOGIN
    to_talk = Door(gate, pages, each)
    to_look = Door(gate, pages * door.SOCKETS_TO_LOOK, each * door.SOCKETS_TO_LOOK)
    acp = AcpSocket(gate, agent, max_frame_bytes=bridge.max_frame_bytes)
    app.router.routes += [WebSocketRoute("/acp", to_talk.to(acp.serve)), *scene_routes(gate, scene, to_look)]
    app.mount("/", WebApp(web_dist))
    return app


def scene_routes(gate: login.Gate, scene: Scene, door: Door) -> list[BaseRoute]:
    """The scene's page and sockets, for everyone and for one viewer, and the robot's camera."""
    page, socket = ScenePage(gate, scene).answer, door.to(SceneSocket(gate, scene).serve)
    return [
        WebSocketRoute("/camera", door.to(CameraSocket(gate, scene).serve)),
        WebSocketRoute("/scene", socket),
        Route("/scene", with_slash),
        Route("/scene/", page),
        WebSocketRoute("/scene/{viewer}", socket),
        Route("/scene/{viewer}", with_slash),
        Route("/scene/{viewer}/", page),
        WebSocketRoute("/scene/{viewer}/control", door.to(SceneControl(gate, scene).serve)),
        Route("/scene/{viewer}/moved", CameraMoved(gate, scene).answer, methods=["POST"]),
    ]


def _says(status: int) -> Any:
    """An exception handler that answers with the exception's sentence."""

    async def answer(_: Request, error: Exception) -> JSONResponse:
        return JSONResponse({"error": str(error)}, status_code=status)

    return answer


async def _http_error(_: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)  # noqa: S101 - registered for it
    sentence = "There is no such address." if error.status_code == 404 else f"{error.detail}."
    return JSONResponse({"error": sentence}, status_code=error.status_code, headers=error.headers)
