"""What retention needs of the database: the size of each session, changing an event, and giving space back.

Nothing here decides what is removed: that is in `retention`. Every call is short, so that a write waits for one of
them at most.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import sqlalchemy as sa

from backend.agent.sessions.database import vacuum_step
from backend.agent.sessions.store import EVENTS, MAX_TEXT_CHARS, OWNER, SESSIONS, Store

LARGE_BYTES = 4096
"""An event of more bytes may contain a photo or a sound."""


@dataclass(frozen=True)
class SessionSize:
    """How much of a session is in the database: `bytes` of all its events, `large_bytes` of those that may contain a
    photo or a sound. `updated` is the time of its last change in Unix seconds."""

    id: str
    owner: str
    updated: float
    events: int
    bytes: int
    large_bytes: int


async def sizes(store: Store) -> list[SessionSize]:
    """The size of every session, those without events too, the one changed longest ago first."""
    length = sa.func.length(EVENTS.c.update)
    columns = (
        SESSIONS.c.id,
        sa.func.substr(OWNER, 1, MAX_TEXT_CHARS),
        SESSIONS.c.updated,
        sa.func.count(EVENTS.c.seq),
        sa.func.coalesce(sa.func.sum(length), 0),
        sa.func.coalesce(sa.func.sum(sa.case((length > LARGE_BYTES, length), else_=0)), 0),
    )
    joined = SESSIONS.outerjoin(EVENTS, EVENTS.c.session_id == SESSIONS.c.id)
    query = sa.select(*columns).select_from(joined).group_by(SESSIONS.c.id).order_by(SESSIONS.c.updated)

    def work() -> list[SessionSize]:
        with store.engine.connect() as connection:
            return [
                SessionSize(session_id, owner, updated, events, int(size), int(large))
                for session_id, owner, updated, events, size, large in connection.execute(query)
            ]

    return await store.run(work)


async def large_events(store: Store, session_id: str) -> list[int]:
    """The numbers of a session's events that may contain a photo or a sound."""
    this = (EVENTS.c.session_id == session_id) & (sa.func.length(EVENTS.c.update) > LARGE_BYTES)
    return [row.seq for row in await store.read(sa.select(EVENTS.c.seq).where(this).order_by(EVENTS.c.seq))]


async def change_event(store: Store, session_id: str, seq: int, change: Callable[[bytes], bytes | None]) -> int:
    """Replace an event's JSON by what `change`, called on the store's thread, makes of it; None leaves it as it is.
    Returns by how many bytes it has become smaller."""
    this = (EVENTS.c.session_id == session_id) & (EVENTS.c.seq == seq)

    def work() -> int:
        with store.engine.begin() as connection:
            before = connection.execute(sa.select(EVENTS.c.update).where(this)).scalar()
            after = change(before) if before is not None else None
            if before is None or after is None:
                return 0
            connection.execute(sa.update(EVENTS).where(this).values(update=after))
            return len(before) - len(after)

    return await store.run(work)


async def give_back_space(store: Store) -> None:
    """Give the space of what was deleted back to the disk, in steps between which others may write.

    PostgreSQL does this by itself (autovacuum).
    """
    if store.engine.dialect.name == "sqlite":
        while await store.run(lambda: vacuum_step(store.engine)):
            pass


async def compact(store: Store) -> None:
    """Rewrite a SQLite file without its free space. Nobody else may use it meanwhile."""
    if store.engine.dialect.name == "sqlite":

        def work() -> None:
            with store.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
                connection.execute(sa.text("VACUUM"))

        await store.run(work)
