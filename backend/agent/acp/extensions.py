"""The requests `_robot/…` of one connection, which go beyond ACP: docs/extensions.md.

Each checks the rights first. Nothing here runs a turn or answers a question; a stop waits for nothing.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any

from acp.exceptions import RequestError
from sqlalchemy.exc import SQLAlchemyError

from backend import wire
from backend.agent.acp.event_page import event_page
from backend.agent.acp.rights import Rights
from backend.agent.control import stop as control
from backend.agent.control.lease import HeldByAnother
from backend.agent.robot.mcp_client import ServerUnavailable
from backend.agent.sessions.database import StoreError
from backend.agent.wiring import Wiring
from backend.identity import Identity, Right
from backend.robot_server import RobotError

EXTENSIONS = (
    "_robot/telemetry",
    "_robot/people",
    "_robot/stop",
    "_robot/release",
    "_robot/take_over",
    "_robot/abilities",
    "_robot/leave",
    "_robot/events",
)
"""The extensions as `initialize` lists them; `telemetry` and `people` are notifications to the client."""


class Extensions:
    """The extensions of one connection. `leave` detaches it from a session."""

    def __init__(self, wiring: Wiring, rights: Rights, leave: Callable[[str], None]) -> None:
        self._wiring = wiring
        self._rights = rights
        self._leave = leave
        self._reading = asyncio.Lock()
        """Held while a page of a log is read: one at a time for each connection, as others need the database, too."""

    async def call(self, name: str, params: dict[str, Any]) -> dict[str, Any]:
        """`stop`, `leave`, `events` and `abilities` for everyone, `release` and `take_over` for supervisors."""
        wiring, rights = self._wiring, self._rights
        try:
            if name == "robot/stop":
                return await control.stop(wiring.link, wiring.sessions, rights.known(), wiring.audit)
            if name == "robot/release":
                return await self._release(rights.authorized(Right.RELEASE))
            if name == "robot/take_over":
                return self._take_over(rights.authorized(Right.TAKE_OVER), params)
            if name == "robot/leave":
                session_id = str(params.get("sessionId"))
                # Waits behind a load of the same session that is still reading the database.
                with contextlib.suppress(StoreError, SQLAlchemyError):  # leaving needs no log
                    await wiring.sessions.get(session_id, rights.known())
                self._leave(session_id)
                return {}
            if name == "robot/events":
                return await self._events(params)
            if name == "robot/abilities":
                rights.known()
                return await wiring.abilities.read()
        except control.StopFailed as failed:
            raise RequestError(wire.INTERNAL_ERROR, str(failed), {"cancelled": failed.cancelled}) from None
        except (RobotError, ServerUnavailable) as error:
            raise RequestError(wire.INTERNAL_ERROR, str(error)) from None
        raise RequestError(wire.METHOD_NOT_FOUND, f"There is no method _{name}.")

    async def _events(self, params: dict[str, Any]) -> dict[str, Any]:
        async with self._reading:
            session = await self._rights.session(str(params.get("sessionId")))
            return await event_page(self._wiring.sessions, session, params)

    async def _release(self, by: Identity) -> dict[str, Any]:
        released = await self._wiring.link.release(by.name)
        self._wiring.audit.record("release", by)
        return released

    def _take_over(self, by: Identity, params: dict[str, Any]) -> dict[str, Any]:
        expected_holder = params.get("from")
        if expected_holder is not None and not isinstance(expected_holder, str):
            raise RequestError(wire.INVALID_PARAMS, "from must be the id of a session.")
        try:
            loser = self._wiring.turns.lease.take_over(params.get("sessionId"), by.name, expected_holder)
        except HeldByAnother as other:
            raise RequestError(wire.INVALID_PARAMS, str(other), {"holder": other.holder}) from None
        if loser:
            self._wiring.audit.record("take_over", by, taken_from=loser.by, session=loser.session_id)
        return {"from": loser.by if loser else None}
