"""No robot moves for nobody: ends the turn that holds the robot when all who may operate it have been gone for a while.

Being there means to be attached to any session with a login that may approve: whoever is sees what is done and can
stop it. A mode that acts without asking, `autonomous`, needs nobody. It never begins anything.
"""

from __future__ import annotations

import asyncio
import logging
import time

from backend.agent.control.lease import Lease
from backend.agent.sessions.sessions import Sessions

log = logging.getLogger(__name__)

CHECK_EVERY_S = 0.25
UNATTENDED_MODE = "autonomous"


class Attendance:
    """Watches one robot's people. `limit_s` is how long all of them may be away; 0 switches the rule off."""

    def __init__(self, sessions: Sessions, lease: Lease, limit_s: float) -> None:
        self._sessions = sessions
        self._lease = lease
        self._limit_s = limit_s
        self._last_seen = time.monotonic()

    async def run(self) -> None:
        """Watch until cancelled."""
        while self._limit_s:
            self._check(time.monotonic())
            await asyncio.sleep(CHECK_EVERY_S)

    def _check(self, now: float) -> None:
        sessions = self._sessions.open_sessions
        if any(listener.may_approve for session in sessions for listener in session.watching):
            self._last_seen = now
            return
        holder = self._lease.holder
        if holder is None or now - self._last_seen < self._limit_s:
            return
        if any(s.id == holder.session_id and s.row.mode == UNATTENDED_MODE for s in sessions):
            return
        log.warning("nobody who may operate the robot is there; the turn of %s ends", holder.by)
        holder.lose("Nobody who may operate me is connected any more")
