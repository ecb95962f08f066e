"""Who is at a connection, and what they may do: every operation asks here first. It changes nothing."""

from __future__ import annotations

from acp.exceptions import RequestError

from backend import wire
from backend.agent.acp.connection import ClientConnection
from backend.agent.sessions.session import Session
from backend.agent.wiring import Wiring
from backend.identity import Identity, Right


class Rights:
    """Those of one connection, at this moment. Everything raises `RequestError` where the answer is no."""

    def __init__(self, wiring: Wiring, connection: ClientConnection) -> None:
        self._wiring = wiring
        self._connection = connection

    def known(self) -> Identity:
        """Who it is."""
        who = self._connection.identity
        if who is None:
            raise RequestError(wire.AUTH_REQUIRED, "Log in first: authenticate with a login token.")
        if who.expired:
            raise RequestError(wire.AUTH_REQUIRED, "This login token has expired. Ask for a new one.")
        return who

    def authorized(self, right: Right) -> Identity:
        """Who it is, and has this right."""
        who = self.known()
        if not who.may(right):
            raise RequestError(wire.NOT_ALLOWED, f"The role {who.role.value} may not {right.value.replace('_', ' ')}.")
        return who

    async def session(self, session_id: str) -> Session:
        """A session that this person may see."""
        session = await self._wiring.sessions.get(session_id, self.known())
        if session is None:
            raise no_session(session_id)
        return session

    async def own(self, session_id: str) -> Session:
        """A session that this person may change: an own one, or anyone's for a supervisor."""
        session = await self.session(session_id)
        who = self.known()
        if session.row.owner != who.name and not who.may(Right.TAKE_OVER):
            raise RequestError(wire.NOT_ALLOWED, f"This session is {session.row.owner}'s. Begin one of your own.")
        return session


def no_session(session_id: str) -> RequestError:
    """What is said of a session that there is not, or not for this person."""
    return RequestError(wire.INVALID_PARAMS, f"There is no session {session_id[:64]}.")
