"""`_robot/people`: the list of connected people, for clients that asked for it and whose login may approve.

The list is compared once a second, so any number of changes in between is one message for each client. Nobody else
learns from here who is connected, and nothing is decided by it.
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
MAX_SESSIONS = 20
"""Sessions that are listed of one person, those attached last."""

Attached = Mapping[str, Session]
"""The sessions that a connection is attached to or about to be, the newest last, by session id."""


class People:
    """The connections of one agent. `run` has to be running for any message to be sent."""

    def __init__(self) -> None:
        self._attached: dict[ClientConnection, Attached] = {}
        """All connections, logged in or not."""
        self._last_sent: dict[ClientConnection, bytes] = {}
        """The frame that each client was sent last. A client that may not have the list is not in it."""

    def add(self, connection: ClientConnection, attached: Attached) -> None:
        """A client has connected. Its identity is read from it each time; `attached` may change at any time."""
        self._attached[connection] = attached

    def remove(self, connection: ClientConnection) -> None:
        """The connection is gone."""
        self._attached.pop(connection, None)
        self._last_sent.pop(connection, None)

    async def run(self) -> None:
        """Send every change until cancelled."""
        while True:
            self._send_changes()
            await asyncio.sleep(EVERY_S)

    def _send_changes(self) -> None:
        receivers = [c for c in self._attached if c.wants_people and c.may_approve]
        if not receivers:
            self._last_sent.clear()
            return
        message = {"jsonrpc": "2.0", "method": METHOD, "params": {"people": list(self._list())}}
        frame = orjson.dumps(message, option=orjson.OPT_APPEND_NEWLINE)
        for connection in receivers:
            if self._last_sent.get(connection) != frame:
                connection.deliver_latest(METHOD, frame)
        self._last_sent = dict.fromkeys(receivers, frame)

    def _list(self) -> Iterator[dict[str, Any]]:
        """Each person once, however many connections they have, sorted by name and role."""
        connections: dict[tuple[str, str, str], list[ClientConnection]] = {}
        for connection in self._attached:
            if (who := connection.identity) is not None and not who.expired:
                connections.setdefault((who.name, who.role.value, who.person), []).append(connection)
        for (name, role, _), theirs in sorted(connections.items(), key=lambda item: item[0]):
            sessions = dict.fromkeys(session_id for connection in theirs for session_id in self._watched(connection))
            newest = list(sessions)[:MAX_SESSIONS]
            yield {"name": name, "role": role, "connections": len(theirs), "sessions": newest}

    def _watched(self, connection: ClientConnection) -> Iterator[str]:
        for session in reversed(list(self._attached[connection].values())):
            if connection in session.watching and not session.deleted:
                yield session.id
