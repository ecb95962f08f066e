"""The list of sessions and its search are the same on every database."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import pytest

from backend.agent.sessions.history import History
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.session import Session
from backend.agent.sessions.store import Store
from tests.agent.sessions.stores import NOW, ROW, event, listed
from tests.databases import Database, SQLite


async def test_the_list_has_every_session_once_newest_first(store: Store) -> None:
    """Moments that differ by a microsecond or not at all, as the events of a busy second have."""
    moments = {f"s{number:03}": NOW + (number // 3) * 1e-6 for number in range(120)}
    for session, moment in sorted(moments.items(), key=lambda item: hash(item[0])):
        owner = "Ana" if session[-1] in "02468" else "Bo"
        await store.add_session(replace(ROW, id=session, owner=owner, created=moment, updated=moment))
        await store.append([event(1, session=session, time=moment)])
    newest_first = sorted(moments, key=lambda session: (moments[session], session), reverse=True)
    assert len(set(moments.values())) == 40
    for page in (7, 50):
        assert await listed(store, page=page) == newest_first
        assert await listed(store, "Ana", page) == [s for s in newest_first if s[-1] in "02468"]
    assert await listed(store, "Nobody") == []


@pytest.mark.parametrize(
    ("search", "found"),
    [
        ("", ["s4", "s3", "s2", "s1"]),
        ("TO LAB", ["s2", "s1"]),
        ("lab to", ["s2", "s1"]),
        ("ben", ["s2"]),
        ("lab 2 ana", ["s1"]),
        ("to lab 2 ana nobody", ["s1"]),
        ("%", ["s3"]),
        ("100%_", ["s3"]),
        ("_b", []),
        ("l_b", []),
        ("/", ["s3"]),
        ("\\", ["s3"]),
        ("' OR 1=1 --", []),
        ("t\x00our", ["s4"]),
        ("🤖", ["s4"]),
        (" ", ["s4", "s3", "s2", "s1"]),
        ("tour " * 5000, ["s4"]),
    ],
)
async def test_a_search_finds_sessions_by_words_of_title_and_owner(store: Store, search: str, found: list[str]) -> None:
    rows = [
        ("s1", "To lab 2", "Ana"),
        ("s2", "to lab 2", "Ben"),
        ("s3", "100%_ a/b \\c", "Cleo"),
        ("s4", "Tour 🤖", "Eva"),
    ]
    for number, (session, title, owner) in enumerate(rows):
        await store.add_session(replace(ROW, id=session, title=title, owner=owner, updated=NOW + number))
        await store.append([event(1, session=session)])
    assert await listed(store, page=1, search=search) == found
    assert await listed(store, owner="Ana", search=search) == [session for session in found if session == "s1"]


async def test_a_search_knows_the_letters_of_other_languages_and_sessions_without_a_title(database: Database) -> None:
    store = Store(database.url)
    await store.open()
    await store.add_session(replace(ROW, title=None, owner="Begoña"))
    await store.append([event(1)])
    assert await listed(store, search="begoña") == ["s1"]
    if isinstance(database, SQLite):  # PostgreSQL follows its locale, which is C in these tests
        assert await listed(store, search="BEGOÑA") == ["s1"]
    await store.close()


async def test_what_is_kept_waits_behind_one_search_at_most(store: Store) -> None:
    await store.add_session(replace(ROW, title="To lab 2"))
    searches = [asyncio.create_task(listed(store, search="lab")) for _ in range(30)]
    await asyncio.sleep(0)  # all of them have asked
    await store.append([event(1)])
    assert sum(search.done() for search in searches) <= 1
    await asyncio.gather(*searches)


async def test_a_session_without_events_is_not_listed(store: Store) -> None:
    await store.add_session(ROW)
    assert await listed(store) == []
    assert await store.session("s1") == ROW


async def test_a_session_in_which_something_happens_is_first(store: Store) -> None:
    for number, session in enumerate(("s1", "s2", "s3")):
        await store.add_session(replace(ROW, id=session, updated=NOW + number))
        await store.append([event(1, session=session, time=NOW + number)])
    assert await listed(store) == ["s3", "s2", "s1"]
    journal = Journal(store)
    running = asyncio.create_task(journal.run())
    session = Session(ROW, journal, History(), 1, 1.0, asyncio.create_task)  # type: ignore[arg-type]
    session.change(mode="observe")
    session.record({"sessionUpdate": "current_mode_update", "currentModeId": "observe"})
    await session.flushed()
    assert await listed(store) == ["s1", "s3", "s2"]
    found = await store.session("s1")
    assert found is not None
    assert found.mode == "observe"
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


async def test_old_events_make_no_session_old(store: Store) -> None:
    """A fork begins now, with a past."""
    await store.add_session(replace(ROW, updated=NOW + 100))
    await store.append([event(1, time=NOW - 100)])
    found = await store.session("s1")
    assert found is not None
    assert found.updated == NOW + 100
