"""One robot, one controller: the turn that acts holds the lease, the others wait in order, a supervisor can take over.

Looking needs no lease. No clock, no I/O: the lease only says whose turn it is.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass(eq=False)
class Claim:
    """A turn that wants to act. `lose` ends it, and is called with the reason, the first half of a sentence."""

    session_id: str
    by: str
    lose: Callable[[str], None]
    granted: asyncio.Event = field(default_factory=asyncio.Event)
    taken_by: str | None = None
    """Who took the robot away from it; None while nobody has."""


class SomebodyElse(Exception):
    """The turn that was to be ended has ended by itself, and `holder` has the robot now."""

    def __init__(self, holder: str) -> None:
        super().__init__(f"{holder} has the robot now, and keeps it: another turn was to end.")
        self.holder = holder


class Lease:
    """Who controls the robot. `holder` is None while nobody acts."""

    def __init__(self) -> None:
        self.holder: Claim | None = None
        self._waiting: list[Claim] = []

    @property
    def waiting(self) -> tuple[Claim, ...]:
        """Those in line, the next one first."""
        return tuple(self._waiting)

    def ask(self, claim: Claim) -> bool:
        """Get in line; true when the robot is free, and the claim holds it at once."""
        self._waiting.append(claim)
        self._pass_on()
        return self.holder is claim

    async def wait(self, claim: Claim) -> None:
        """Return when the claim, which must be in line, holds the robot."""
        await claim.granted.wait()

    def release(self, claim: Claim) -> None:
        """Give the robot back, or leave the line. Doing it twice is harmless."""
        if claim in self._waiting:
            self._waiting.remove(claim)
        if self.holder is claim:
            self.holder = None
            self._pass_on()

    def take_over(self, session_id: str | None, by: str, meant: str | None = None) -> Claim | None:
        """End the holder's turn in the name of `by`, let `session_id` be next, and return who lost it.

        `meant` is the session whose turn is to end. Raises `SomebodyElse`, and changes nothing, when it is another's.
        """
        loser = self.holder
        if meant is not None and loser is not None and loser.session_id != meant:
            raise SomebodyElse(loser.by)
        self._waiting.sort(key=lambda claim: claim.session_id != session_id)  # stable: the rest keep their order
        if loser is None or loser.session_id == session_id:
            return None
        loser.taken_by = by
        loser.lose(f"{by} took the robot over")
        return loser

    def _pass_on(self) -> None:
        if self.holder is None and self._waiting:
            self.holder = self._waiting.pop(0)
            self.holder.granted.set()
