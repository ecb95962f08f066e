"""What the tests of the store and of its database share."""

from __future__ import annotations

from backend.agent.sessions.store import Event, SessionRow, Store, as_json
from backend.identity import person_named

NOW = 1_795_246_000.123456
ROW = SessionRow("s1", "Ana", None, "/", "supervised", "offline/commands", None, NOW, NOW)
ODD_TEXTS = ["half a character \ud83d", "NUL \x00 inside", "𝄞 🤖", "x" * 5000, "'; DROP TABLE events; --"]


def event(seq: int, text: str = "hello", session: str = "s1", time: float = NOW) -> Event:
    return Event(session, seq, time, as_json({"text": text}))


async def numbers(store: Store, session: str = "s1", after: int = 0, upto: int | None = None) -> list[int]:
    return [event.seq async for event in store.events(session, after, upto)]


async def listed(store: Store, owner: str | None = None, page: int = 50, search: str = "") -> list[str]:
    """The ids of the list, read page by page."""
    found: list[str] = []
    before: tuple[float, str] | None = None
    while rows := await store.sessions(person_named(owner) if owner else None, before, page, search):
        found += [row.id for row in rows]
        before = (rows[-1].updated, rows[-1].id)
    return found
