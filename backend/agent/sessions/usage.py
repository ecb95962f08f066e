"""How much each session and each login has in the database: counted once at the start, then with every event.

It is a count in memory, so that no prompt waits for the database. Nothing here decides what is too much.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

from backend.agent.sessions import upkeep
from backend.agent.sessions.store import Event, SessionRow, Store


@dataclass
class SessionUse:
    """What a session uses. `owner` is the person, `large_bytes` those of events that may contain a photo or a sound.
    `updated` is the time of its last event in Unix seconds."""

    id: str
    owner: str
    updated: float
    events: int = 0
    bytes: int = 0
    large_bytes: int = 0


@dataclass
class LoginUse:
    """What all sessions of one owner use."""

    sessions: int = 0
    bytes: int = 0


class Usage:
    """The sizes of all sessions."""

    def __init__(self) -> None:
        self._sessions: dict[str, SessionUse] = {}
        self._owners: defaultdict[str, LoginUse] = defaultdict(LoginUse)
        self.bytes = 0
        """Of all sessions."""

    async def read(self, store: Store) -> None:
        """Count what is in the database. Only before the first event is appended."""
        for size in await upkeep.sizes(store):
            use = SessionUse(size.id, size.owner, size.updated, size.events, size.bytes, size.large_bytes)
            self._sessions[use.id] = use
            self._owners[use.owner].sessions += 1
            self._count(use, size.bytes)

    @property
    def sessions(self) -> int:
        """The number of sessions, those without events too."""
        return len(self._sessions)

    def add_session(self, row: SessionRow) -> None:
        """A session has begun."""
        self._sessions[row.id] = SessionUse(row.id, row.person, row.updated)
        self._owners[row.person].sessions += 1

    def add_event(self, event: Event) -> None:
        """An event was appended. One of a session that was deleted counts for nobody."""
        if use := self._sessions.get(event.session_id):
            size = len(event.raw)
            use.events += 1
            use.bytes += size
            use.large_bytes += size if size > upkeep.LARGE_BYTES else 0
            use.updated = max(use.updated, event.time)
            self._count(use, size)

    def add_copy(self, original: str, copy: str) -> None:
        """A session has got the events of another one."""
        source, use = self._sessions.get(original), self._sessions.get(copy)
        if source and use:
            use.events, use.large_bytes = use.events + source.events, source.large_bytes
            use.bytes += source.bytes
            self._count(use, source.bytes)

    def shrink(self, session_id: str, removed_bytes: int, *, no_media: bool = False) -> None:
        """A session's events have become smaller; with `no_media`, they contain no photo and no sound any more."""
        if use := self._sessions.get(session_id):
            use.bytes -= removed_bytes
            use.large_bytes = 0 if no_media else max(0, use.large_bytes - removed_bytes)
            self._count(use, -removed_bytes)

    def remove(self, session_id: str) -> None:
        """A session was deleted."""
        if use := self._sessions.pop(session_id, None):
            self._count(use, -use.bytes)
            owner = self._owners[use.owner]
            owner.sessions -= 1
            if not owner.sessions:
                del self._owners[use.owner]

    def of_session(self, session_id: str) -> int:
        """The bytes of one session."""
        use = self._sessions.get(session_id)
        return use.bytes if use else 0

    def of_owner(self, owner: str) -> LoginUse:
        """What all sessions of one owner use."""
        return self._owners.get(owner) or LoginUse()

    def oldest_first(self, owner: str | None = None) -> list[SessionUse]:
        """The sessions of one owner or of everybody, the one without an event for longest first."""
        chosen = [use for use in self._sessions.values() if owner is None or use.owner == owner]
        return sorted(chosen, key=lambda use: use.updated)

    def _count(self, use: SessionUse, size: int) -> None:
        self._owners[use.owner].bytes += size
        self.bytes += size
