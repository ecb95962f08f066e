"""The attendance rule: the robot acts only while somebody who may operate it is connected.

When all of them have been away for a while, the turn that controls the robot is cancelled. A person counts as present
while attached to any session with a login that may approve, because they see what the robot does and can stop it. The
mode `autonomous`, which acts without asking, needs nobody. This rule only cancels turns; it never starts anything.
"""

from __future__ import annotations

import asyncio
import logging
import time

from backend.agent.control.lease import Claim, Lease
from backend.agent.sessions.sessions import Sessions

log = logging.getLogger(__name__)

CHECK_EVERY_S = 0.25
UNATTENDED_MODE = "autonomous"


class Attendance:
    """The rule for one robot. `limit_s` is how long, in seconds, everybody may be away; 0 switches the rule off."""

    def __init__(self, sessions: Sessions, lease: Lease, limit_s: float) -> None:
        self._sessions = sessions
        self._lease = lease
        self._limit_s = limit_s
        self._last_present = time.monotonic()
        self._revoked: Claim | None = None
        """The claim that was revoked last. A turn that halts keeps its claim until the robot is at rest."""

    async def run(self) -> None:
        """Check until cancelled."""
        while self._limit_s:
            self._check(time.monotonic())
            await asyncio.sleep(CHECK_EVERY_S)

    def _check(self, now: float) -> None:
        sessions = self._sessions.open_sessions
        if any(listener.may_approve for session in sessions for listener in session.watching):
            self._last_present = now
            return
        holder = self._lease.holder
        if holder is None or holder is self._revoked or now - self._last_present < self._limit_s:
            return
        if any(s.id == holder.session_id and s.row.mode == UNATTENDED_MODE for s in sessions):
            return
        self._revoked = holder
        log.warning("nobody who may operate the robot is connected; the turn of %s is cancelled", holder.by)
        holder.revoke("Nobody who may operate me is connected any more")
