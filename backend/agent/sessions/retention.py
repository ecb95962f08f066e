"""What may be kept of sessions: the quota of each login, and what is removed when it is old or too much.

Order of removal: empty sessions, then photos and sounds, then whole sessions, always the oldest first. A session that
somebody watches or in which a turn runs is never touched.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable

from backend.agent.sessions import upkeep
from backend.agent.sessions.media import without_media
from backend.agent.sessions.sessions import Sessions
from backend.agent.sessions.store import Store
from backend.agent.sessions.usage import SessionUse, Usage
from backend.config import Storage
from backend.identity import Identity, Role

log = logging.getLogger(__name__)

EVERY_S = 3600.0
EMPTY_S = 3600.0
"""A session in which nothing has happened for so long is deleted."""
ROOM = 0.9
"""What is too much is reduced to this share of its limit, so that not every prompt has to make room."""
_DAY_S = 86400.0


class QuotaExceeded(Exception):
    """A login may keep no more; the text says what to do."""


class Retention:
    """The limits of one agent's database. `run` enforces those that concern everybody."""

    def __init__(self, store: Store, sessions: Sessions, usage: Usage, limits: Storage) -> None:
        self._store = store
        self._sessions = sessions
        self._usage = usage
        self._limits = limits
        self._wake = asyncio.Event()
        self._one_at_a_time = asyncio.Lock()

    def size_of(self, session_id: str) -> int:
        """The bytes of a session."""
        return self._usage.of_session(session_id)

    async def admit(self, who: Identity, owner: str, more_bytes: int, *, new_session: bool = False) -> None:
        """Let `who` add so many bytes to the sessions of the person `owner`, or a new session. Raises `QuotaExceeded`.

        Of a visitor, the oldest sessions make room: a kiosk has nobody who would delete them.
        """
        if 0 < self._limits.max_bytes < self._usage.bytes or 0 < self._limits.max_sessions < self._usage.sessions:
            self._wake.set()
        if self._fits(who, owner, more_bytes, new_session):
            return
        if who.role == Role.VISITOR:
            async with self._one_at_a_time:
                await self._make_room(who, owner, more_bytes, new_session)
            if self._fits(who, owner, more_bytes, new_session):
                return
        max_bytes, max_sessions = self._limits.quota(who.role.value)
        used = self._usage.of_owner(owner)
        mine = "Your sessions use" if owner == who.person else "The sessions of this owner use"
        raise QuotaExceeded(
            f"{mine} {_mb(used.bytes)} of {_mb(max_bytes)}, in {used.sessions} of {max_sessions or 'any number of'} "
            "sessions: there is no room for this. Delete sessions that are no longer needed, or ask whoever runs the "
            "robot for more."
        )

    def _fits(self, who: Identity, owner: str, more_bytes: int, new_session: bool, share: float = 1.0) -> bool:
        max_bytes, max_sessions = self._limits.quota(who.role.value)
        used = self._usage.of_owner(owner)
        return not (
            0 < max_bytes * share < used.bytes + more_bytes or 0 < max_sessions * share < used.sessions + new_session
        )

    async def _make_room(self, who: Identity, owner: str, more_bytes: int, new_session: bool) -> None:
        for use in self._usage.oldest_first(owner):
            if self._fits(who, owner, more_bytes, new_session, ROOM):
                return
            await self._sessions.remove_unused(use.id)

    async def run(self) -> None:
        """Enforce the limits now, every hour, and when there is too much, until cancelled."""
        while True:
            try:
                async with self._one_at_a_time:
                    removed = await self._enforce(time.time())
                if removed:
                    log.info("%d sessions were removed or reduced, as [agent.storage] says", removed)
                await upkeep.give_back_space(self._store)
            except Exception as error:
                log.debug("retention: %s", type(error).__name__)
            self._wake.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(EVERY_S):
                    await self._wake.wait()

    async def _enforce(self, now: float) -> int:
        """Remove what is empty, old or too much; returns the number of sessions that were removed or reduced."""
        limits, removed = self._limits, 0
        for use in self._usage.oldest_first():
            age = now - use.updated
            empty = use.events == 0 and age > EMPTY_S
            if empty or 0 < limits.session_days * _DAY_S < age:
                removed += await self._sessions.remove_unused(use.id)
            elif use.large_bytes and 0 < limits.media_days * _DAY_S < age:
                removed += await self._remove_media(use)
        if 0 < limits.max_sessions < self._usage.sessions:
            removed += await self._remove_oldest(lambda: self._usage.sessions > limits.max_sessions * ROOM)
        if 0 < limits.max_bytes < self._usage.bytes:
            for use in self._usage.oldest_first():
                if self._usage.bytes > limits.max_bytes * ROOM and use.large_bytes:
                    removed += await self._remove_media(use)
            removed += await self._remove_oldest(lambda: self._usage.bytes > limits.max_bytes * ROOM)
        return removed

    async def _remove_oldest(self, too_much: Callable[[], bool]) -> int:
        removed = 0
        for use in self._usage.oldest_first():
            if not too_much():
                break
            removed += await self._sessions.remove_unused(use.id)
        return removed

    async def _remove_media(self, use: SessionUse) -> bool:
        """Take photos and sounds out of a session that nobody uses; whether it became smaller."""
        if self._sessions.in_use(use.id):
            return False
        before = use.bytes
        for seq in await upkeep.large_events(self._store, use.id):
            smaller = await upkeep.change_event(self._store, use.id, seq, without_media)
            self._usage.shrink(use.id, smaller)
        self._usage.shrink(use.id, 0, no_media=True)  # what is still large is text, and stays
        return use.bytes < before


def _mb(size: int) -> str:
    return f"{size / 1024 / 1024:.0f} MB" if size else "any amount"
