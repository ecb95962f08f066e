"""The HTTP API for the robot as a whole: stop, release and health.

Stop goes directly to the robot's server and must never depend on the agent (`stop.py`). Everyone who is logged in may
stop the robot; only a supervisor may release the stop.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse

import backend
from backend.audit import Audit
from backend.bridge.limits import Limits
from backend.bridge.login import Authenticator
from backend.bridge.stop import RobotStop
from backend.bridge.upstream import Agent
from backend.identity import Right
from backend.robot_server import RobotError, RobotServerClient


class Health:
    """Whether agent and robot are up. Both are asked at most once a second, however many clients ask."""

    def __init__(self, agent: Agent, robot: RobotServerClient, robot_name: str, limits: Limits) -> None:
        self._agent = agent
        self._robot = robot
        self._robot_name = robot_name
        self._max_age = limits.health_age_seconds
        self._lock = asyncio.Lock()  # held while agent and robot are asked
        self._report: dict[str, Any] = {}
        self._reported_at = float("-inf")  # of time.monotonic

    async def report(self) -> dict[str, Any]:
        """The answer of `/api/health`."""
        async with self._lock:
            if time.monotonic() - self._reported_at > self._max_age:
                self._report = await self._ask()
                self._reported_at = time.monotonic()
            return self._report

    async def _ask(self) -> dict[str, Any]:
        if self._robot.has_paths:
            agent_error, (robot_up, robot_detail) = await asyncio.gather(self._agent.probe(), self._robot.health())
        else:
            agent_error = await self._agent.probe()
            robot_up, robot_detail = agent_error is None, "Only the agent reaches this robot: it is behind a command."
        return {
            "status": "ok" if agent_error is None and robot_up else "degraded",
            "version": backend.__version__,
            "agent": {"up": agent_error is None, "detail": agent_error or "ready"},
            "robot": {"up": robot_up, "detail": robot_detail},
            "robot_name": self._robot_name,
        }


def router(
    authenticator: Authenticator, robot: RobotServerClient, robot_stop: RobotStop, health: Health, audit: Audit
) -> APIRouter:
    """The routes `/api/stop`, `/api/release` and `/api/health`. `audit` is told who stops and releases."""
    routes = APIRouter(prefix="/api")

    @routes.post("/stop")
    async def stop(request: Request) -> JSONResponse:
        login = authenticator.admit(request, to_stop=True)
        confirmed = False
        try:
            answer = await _answer(robot_stop.press(login))
            confirmed = answer.status_code == 200
            return answer
        finally:  # also where the page that pressed has gone meanwhile
            audit.record("stop", login.identity, confirmed=confirmed)

    @routes.post("/release")
    async def release(request: Request) -> JSONResponse:
        who = authenticator.admit(request).identity
        if not who.may(Right.RELEASE):
            return JSONResponse({"error": "Only a supervisor can release the stop."}, status_code=403)
        answer = await _answer(robot.release(who.name))
        if answer.status_code == 200:
            audit.record("release", who)
        return answer

    @routes.get("/health")
    async def ask_health() -> JSONResponse:
        return JSONResponse(await health.report(), headers={"Cache-Control": "no-store"})

    return routes


async def _answer(request: Awaitable[dict[str, Any]]) -> JSONResponse:
    try:
        return JSONResponse(await request)
    except RobotError as error:
        return JSONResponse({"error": str(error)}, status_code=503)
