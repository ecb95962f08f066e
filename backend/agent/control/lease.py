"""The control lease: one turn at a time controls the robot, the others wait in order, and a supervisor can take over.

Reading the robot needs no lease. The lease has no clock and does no I/O, and it never moves the robot.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass(eq=False)
class Claim:
    """The claim of a turn that wants to act. `by` is the name of the person who started the turn.

    `revoke` cancels the turn that has the lease. Its argument is the reason, as the first half of a sentence.
    """

    session_id: str
    by: str
    revoke: Callable[[str], None]
    granted: asyncio.Event = field(default_factory=asyncio.Event)
    taken_by: str | None = None
    """The name of the person who took the robot over from this turn; None while nobody has."""


class HeldByAnother(Exception):
    """The turn that was to be cancelled has ended already, and the turn of `holder` controls the robot now."""

    def __init__(self, holder: str) -> None:
        super().__init__(f"{holder} has the robot now, and keeps it: another turn was to end.")
        self.holder = holder


class Lease:
    """Who controls the robot. `holder` is the claim that has the lease; None while nobody acts."""

    def __init__(self) -> None:
        self.holder: Claim | None = None
        self._waiting: list[Claim] = []

    @property
    def waiting(self) -> tuple[Claim, ...]:
        """The claims that wait, the next one first."""
        return tuple(self._waiting)

    def ask(self, claim: Claim) -> bool:
        """Put a claim at the end of the queue. True means that the robot was free and the claim has the lease now."""
        self._waiting.append(claim)
        self._grant_next()
        return self.holder is claim

    async def wait(self, claim: Claim) -> None:
        """Return when the claim, which must be in the queue, has the lease."""
        await claim.granted.wait()

    def release(self, claim: Claim) -> None:
        """Give the lease back, or leave the queue. A second call does nothing."""
        if claim in self._waiting:
            self._waiting.remove(claim)
        if self.holder is claim:
            self.holder = None
            self._grant_next()

    def take_over(self, session_id: str | None, by: str, meant: str | None = None) -> Claim | None:
        """Cancel the turn that has the lease, put `session_id` first in the queue, and return the revoked claim.

        `by` is the name of the supervisor who takes over; `meant`, where given, is the session whose turn is to be
        cancelled. Raises `HeldByAnother`, and changes nothing, when another session has the lease. Returns None when
        there is nobody to take the robot from.
        """
        loser = self.holder
        if meant is not None and loser is not None and loser.session_id != meant:
            raise HeldByAnother(loser.by)
        self._waiting.sort(
            key=lambda claim: claim.session_id != session_id
        )  # a stable sort: the others keep their order
        if loser is None or loser.session_id == session_id:
            return None
        loser.taken_by = by
        loser.revoke(f"{by} took the robot over")
        return loser

    def _grant_next(self) -> None:
        if self.holder is None and self._waiting:
            self.holder = self._waiting.pop(0)
            self.holder.granted.set()
