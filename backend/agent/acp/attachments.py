"""The sessions that one connection is attached to: attaching with or without a replay, and leaving.

A client can leave a session, log out or log in as somebody else while an attachment still waits. So each step checks
anew whether it is still wanted and allowed.
"""

from __future__ import annotations

import asyncio

import orjson
from acp.exceptions import RequestError

from backend import wire
from backend.agent.acp import commands
from backend.agent.acp.connection import ClientConnection
from backend.agent.acp.rights import Rights, no_session
from backend.agent.sessions.session import Session
from backend.agent.sessions.sessions import Sessions

MAX_ATTACHED = 512
"""Sessions that one connection may watch at once: each is kept in memory as long as somebody watches it."""


class Attachments:
    """Those of one connection. `sessions` are the sessions it is attached to or about to be, the newest last."""

    def __init__(self, sessions: Sessions, connection: ClientConnection, rights: Rights) -> None:
        self.sessions: dict[str, Session] = {}
        self._all_sessions = sessions
        self._connection = connection
        self._rights = rights
        self._one_replay = asyncio.Lock()
        """Held during a replay: two at once would mix their events."""

    async def attach(self, session: Session, after: int | None = None) -> None:
        """Attach when the replays before have ended, and replay the events after number `after`; None replays none.

        Raises `RequestError` when the login no longer shows this session.
        """
        self.sessions.pop(session.id, None)
        self._take_place(session)
        async with self._one_replay:
            if self.sessions.get(session.id) is session:  # else the client has left it meanwhile
                await self.attach_at_once(session, after)

    async def attach_at_once(self, session: Session, after: int | None = None) -> None:
        """Attach as `attach` does, but wait for no other replay."""
        if not self._all_sessions.shows(session, self._rights.known()):  # the login may have changed meanwhile
            self.sessions.pop(session.id, None)
            raise no_session(session.id)
        self._take_place(session)
        if after is None:
            await session.attach(self._connection)
        else:
            await session.attach(self._connection, lambda upto: self._all_sessions.replay(session, after, upto))

    def _take_place(self, session: Session) -> None:
        """Count a session as watched. Raises `RequestError` where the client watches too many."""
        if session.id not in self.sessions and len(self.sessions) >= MAX_ATTACHED:
            text = f"This connection watches {MAX_ATTACHED} sessions already. Leave one (_robot/leave), then try again."
            raise RequestError(wire.NOT_ALLOWED, text)
        self.sessions[session.id] = session

    def send_commands(self, session: Session) -> None:
        """Send the list of slash commands, unless the client has left the session meanwhile."""
        if self.sessions.get(session.id) is not session:
            return
        update = {"sessionUpdate": "available_commands_update", "availableCommands": commands.available()}
        params = {"sessionId": session.id, "update": update}
        message = {"jsonrpc": "2.0", "method": "session/update", "params": params}
        self._connection.deliver(orjson.dumps(message, option=orjson.OPT_APPEND_NEWLINE))

    def apply_rights(self) -> None:
        """After the identity has changed: leave the sessions that it may not see, and ask only what it may answer."""
        who = self._rights.known()
        for session in list(self.sessions.values()):
            if not self._all_sessions.shows(session, who):
                self.detach(session.id)
            elif self._connection in session.watching:  # else attaching does it
                session.rights_changed(self._connection)

    def detach(self, session_id: str) -> None:
        """Leave a session. An attachment that still waits does not happen."""
        self._connection.folders.pop(session_id, None)
        if session := self.sessions.pop(session_id, None):
            session.detach(self._connection)

    def detach_all(self) -> None:
        """Leave every session."""
        self.sessions.clear()
        self._connection.folders.clear()
        for session in self._all_sessions.open_sessions:
            session.detach(self._connection)

    def forget(self, session_id: str) -> None:
        """A session has been deleted."""
        self._connection.folders.pop(session_id, None)
        self.sessions.pop(session_id, None)
