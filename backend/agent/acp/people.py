"""`_robot/people`: who is connected, for those who may operate the robot and asked to know.

Looked at once a second, so whatever happens in between, and however many come and go, is one message for each who
asked. Nobody else ever learns from here who is there, and nothing is ever decided by it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Mapping
from typing import Any

import orjson

from backend.agent.acp.connection import ClientConnection
from backend.agent.sessions.session import Session

METHOD = "_robot/people"
EVERY_S = 1.0

Attached = Mapping[str, Session]
"""The sessions that a connection is attached to or about to be, the newest last."""


class People:
    """The connections of one agent. `run` has to be running for anybody to be told."""

    def __init__(self) -> None:
        self._attached: dict[ClientConnection, Attached] = {}
        """Of everyone who is connected, logged in or not."""
        self._told: dict[ClientConnection, bytes] = {}
        """What somebody was told last; nobody who may not be told is in it."""

    def enter(self, connection: ClientConnection, attached: Attached) -> None:
        """Somebody connects; who it is turns out later, and `attached` changes."""
        self._attached[connection] = attached

    def leave(self, connection: ClientConnection) -> None:
        """The connection is gone."""
        self._attached.pop(connection, None)
        self._told.pop(connection, None)

    async def run(self) -> None:
        """Tell of every change until cancelled."""
        while True:
            self._tell()
            await asyncio.sleep(EVERY_S)

    def _tell(self) -> None:
        asking = [connection for connection in self._attached if connection.takes_people and connection.may_approve]
        if not asking:
            self._told.clear()
            return
        message = {"jsonrpc": "2.0", "method": METHOD, "params": {"people": list(self._here())}}
        frame = orjson.dumps(message, option=orjson.OPT_APPEND_NEWLINE)
        for connection in asking:
            if self._told.get(connection) != frame:
                connection.show_latest(METHOD, frame)
        self._told = dict.fromkeys(asking, frame)

    def _here(self) -> Iterator[dict[str, Any]]:
        """Each person once, however many screens they have open."""
        connections: dict[tuple[str, str], list[ClientConnection]] = {}
        for connection in self._attached:
            if (who := connection.identity) is not None and not who.expired:
                connections.setdefault((who.name, who.role.value), []).append(connection)
        for (name, role), theirs in sorted(connections.items(), key=lambda item: item[0]):
            sessions = dict.fromkeys(session_id for connection in theirs for session_id in self._watched(connection))
            yield {"name": name, "role": role, "connections": len(theirs), "sessions": list(sessions)}

    def _watched(self, connection: ClientConnection) -> Iterator[str]:
        for session in reversed(list(self._attached[connection].values())):
            if connection in session.watching and not session.deleted:
                yield session.id
