"""The telemetry and the stop of a robot server, over real sockets, of a robot that goes on moving after a cancel."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from backend import telemetry
from backend.agent.robot.robot_client import RobotClient
from backend.robot_server import RobotServerClient
from backend.telemetry import Battery, Pose, State, Stop, Twist
from tests.processes import eventually

EVERY_S = 0.01


@dataclass
class Runaway:
    """The robot. A test sets how fast it moves, what a stop does, and whether it tells anything."""

    speed: float = 0.5
    obeys_stop: bool = True
    takes_stop: bool = True
    silent: bool = False
    stop: Stop | None = None
    stops: list[str] = field(default_factory=list)
    time: float = 0.0

    async def telemetry(self, socket: WebSocket) -> None:
        await socket.accept()
        sending = asyncio.create_task(self._send(socket))
        with suppress(WebSocketDisconnect):
            while True:
                await socket.receive_bytes()  # a subscription, and at the end that the agent has gone
        sending.cancel()

    async def _send(self, socket: WebSocket) -> None:
        while True:
            await asyncio.sleep(EVERY_S)
            self.time += EVERY_S
            if not self.silent:
                await socket.send_bytes(telemetry.encode(self._state()))

    def _state(self) -> State:
        pose, twist = Pose(0.0, 0.0, 0.0), Twist(self.speed, 0.0)
        return State(self.time, "Sancho", pose, twist, Battery(1.0, False), None, self.stop, None)

    async def set_stop(self, request: Request) -> JSONResponse:
        if not self.takes_stop:
            return JSONResponse({}, 500)
        by = request.query_params["by"]
        self.stops.append(by)
        self.stop = self.stop or Stop(by, self.time)
        if self.obeys_stop:
            self.speed = 0.0
        return JSONResponse({"stopped": {"by": by, "at": self.time}})

    @asynccontextmanager
    async def linked(self, rest_timeout: float = 0.3) -> AsyncIterator[RobotClient]:
        """The agent's client of it, which has heard how it moves. `rest_timeout` and what is stale are short."""
        routes = [WebSocketRoute("/telemetry", self.telemetry), Route("/stop", self.set_stop, methods=["POST"])]
        config = uvicorn.Config(Starlette(routes=routes), port=0, log_level="error", ws="websockets-sansio")
        config.timeout_graceful_shutdown = 1
        server = uvicorn.Server(config)
        serving = asyncio.create_task(server.serve())
        following: asyncio.Task[None] | None = None
        try:
            await eventually(lambda: server.started, "the robot server")
            port = server.servers[0].sockets[0].getsockname()[1]
            ours = RobotServerClient(f"http://127.0.0.1:{port}", b"secret" * 10)
            link = RobotClient(ours, stale_after=0.2, rest_timeout=rest_timeout)
            following = asyncio.create_task(link.run())
            await eventually(lambda: link.state, "the telemetry")
            yield link
        finally:
            if following is not None:
                following.cancel()
            server.should_exit = True
            await asyncio.wait([task for task in (following, serving) if task])
