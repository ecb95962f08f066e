"""What the person at a connection may do: every operation checks it here first. Nothing is changed here."""

from __future__ import annotations

from acp.exceptions import RequestError

from backend import wire
from backend.agent.acp.connection import ClientConnection
from backend.agent.sessions.session import Session
from backend.agent.wiring import Wiring
from backend.identity import Identity, Right


class Rights:
    """The rights of one connection at this moment. Every method raises `RequestError` where they do not suffice."""

    def __init__(self, wiring: Wiring, connection: ClientConnection) -> None:
        self._wiring = wiring
        self._connection = connection

    def known(self) -> Identity:
        """The identity of a connection that is logged in, with a login that has not expired."""
        who = self._connection.identity
        if who is None:
            raise RequestError(wire.AUTH_REQUIRED, "Log in first: authenticate with a login token.")
        if who.expired:
            raise RequestError(wire.AUTH_REQUIRED, "This login token has expired. Ask for a new one.")
        return who

    def authorized(self, right: Right) -> Identity:
        """The identity, if it has this right."""
        who = self.known()
        if not who.may(right):
            raise RequestError(wire.NOT_ALLOWED, f"The role {who.role.value} may not {right.value.replace('_', ' ')}.")
        return who

    async def session(self, session_id: str) -> Session:
        """The session, if this person may see it."""
        session = await self._wiring.sessions.get(session_id, self.known())
        if session is None:
            raise no_session(session_id)
        return session

    async def own(self, session_id: str) -> Session:
        """The session, if this person may change it: it is theirs, or they are a supervisor."""
        session = await self.session(session_id)
        who = self.known()
        if session.row.person != who.person and not who.may(Right.TAKE_OVER):
            raise RequestError(wire.NOT_ALLOWED, f"This session is {session.row.owner}'s. Begin one of your own.")
        return session


def no_session(session_id: str) -> RequestError:
    """The error for a session that does not exist. One that this person may not see gets the same."""
    return RequestError(wire.INVALID_PARAMS, f"There is no session {session_id[:64]}.")
