"""What a person can ask of the whole system at once: stop, release, and how it is.

Stop goes straight to the robot server. Everyone who is logged in may stop; only a supervisor may release.
"""

from __future__ import annotations

import asyncio
import time
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse

import backend
from backend.bridge.login import Gate
from backend.bridge.robot_link import RobotDownError, RobotLink
from backend.bridge.upstream import Agent
from backend.identity import Right

_FRESH_SECONDS = 1.0


class Health:
    """How the agent and the robot are; asked at most once a second, however many ask."""

    def __init__(self, agent: Agent, robot: RobotLink, robot_name: str) -> None:
        self._agent = agent
        self._robot = robot
        self._robot_name = robot_name
        self._asking = asyncio.Lock()
        self._known: dict[str, Any] = {}
        self._known_at = float("-inf")

    async def report(self) -> dict[str, Any]:
        """What `/api/health` answers."""
        async with self._asking:
            if time.monotonic() - self._known_at > _FRESH_SECONDS:
                self._known = await self._ask()
                self._known_at = time.monotonic()
            return self._known

    async def _ask(self) -> dict[str, Any]:
        trouble, (robot_up, robot_detail) = await asyncio.gather(self._agent.probe(), self._robot.health())
        return {
            "status": "ok" if trouble is None and robot_up else "degraded",
            "version": backend.__version__,
            "agent": {"up": trouble is None, "detail": trouble or "ready"},
            "robot": {"up": robot_up, "detail": robot_detail},
            "robot_name": self._robot_name,
        }


def router(gate: Gate, robot: RobotLink, health: Health) -> APIRouter:
    """The routes of stop, release and health."""
    routes = APIRouter(prefix="/api")

    @routes.post("/stop")
    async def stop(request: Request) -> JSONResponse:
        who = gate.admit(request, to_stop=True).identity
        return await _told(robot.stop(who.name))

    @routes.post("/release")
    async def release(request: Request) -> JSONResponse:
        who = gate.admit(request).identity
        if not who.may(Right.RELEASE):
            return JSONResponse({"error": "Only a supervisor can release the stop."}, status_code=403)
        return await _told(robot.release(who.name))

    @routes.get("/health")
    async def ask_health() -> JSONResponse:
        return JSONResponse(await health.report(), headers={"Cache-Control": "no-store"})

    return routes


async def _told(answer: Any) -> JSONResponse:
    try:
        return JSONResponse(await answer)
    except RobotDownError as error:
        return JSONResponse({"error": str(error)}, status_code=503)
