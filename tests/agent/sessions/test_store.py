"""The store does the same on every database: what is kept, in which order it is found, and what it refuses."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import AsyncIterator
from dataclasses import replace
from typing import Any

import pytest
from sqlalchemy.exc import DatabaseError, IntegrityError

from backend.agent.sessions import database as database_module
from backend.agent.sessions import store as store_module
from backend.agent.sessions.history import History
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.session import Session
from backend.agent.sessions.store import Event, SessionRow, Store, StoreError, as_json
from tests.databases import PASSWORD, Cluster, Database, SQLite
from tests.processes import eventually

NOW = 1_795_246_000.123456
ROW = SessionRow("s1", "Ana", None, "/", "supervised", "offline/commands", None, NOW, NOW)
ODD_TEXTS = ["half a character \ud83d", "NUL \x00 inside", "𝄞 🤖", "x" * 5000, "'; DROP TABLE events; --"]


@pytest.fixture
async def store(database: Database) -> AsyncIterator[Store]:
    """An open store on an empty database."""
    store = Store(database.url)
    await store.open()
    yield store
    await store.close()


def event(seq: int, text: str = "hello", session: str = "s1", time: float = NOW) -> Event:
    return Event(session, seq, time, as_json({"text": text}))


async def numbers(store: Store, session: str = "s1", after: int = 0, upto: int | None = None) -> list[int]:
    return [event.seq async for event in store.events(session, after, upto)]


async def listed(store: Store, owner: str | None = None, page: int = 50, search: str = "") -> list[str]:
    """The ids of the list, read page by page."""
    found: list[str] = []
    before: tuple[float, str] | None = None
    while rows := await store.sessions(owner, before, page, search):
        found += [row.id for row in rows]
        before = (rows[-1].updated, rows[-1].id)
    return found


# Rows


async def test_a_session_comes_back_as_it_was_kept(store: Store) -> None:
    row = replace(ROW, title="To lab 2", start_pose={"x": 1.5, "frame": "map"}, thought=False, motion_asks=True)
    await store.add_session(row)
    assert await store.session("s1") == row
    assert await store.session("s2") is None


async def test_a_change_is_to_the_named_columns_of_the_named_session(store: Store) -> None:
    await store.add_session(ROW)
    await store.add_session(replace(ROW, id="s2"))
    await store.append([], {"s1": {"title": "Tea", "mode": "observe", "start_pose": {"x": 0.5}}})
    assert await store.session("s1") == replace(ROW, title="Tea", mode="observe", start_pose={"x": 0.5})
    assert await store.session("s2") == replace(ROW, id="s2")


async def test_no_start_pose_is_null_in_the_database(store: Store, database: Database) -> None:
    await store.add_session(ROW)
    await store.add_session(replace(ROW, id="s2", start_pose={}))
    assert database.execute("SELECT id FROM sessions WHERE start_pose IS NULL") == [("s1",)]
    found = await store.session("s2")
    assert found is not None
    assert found.start_pose == {}


@pytest.mark.parametrize("number", [float("nan"), float("inf"), 10**40])
async def test_a_start_pose_of_a_careless_server_is_kept(store: Store, number: float) -> None:
    await store.add_session(replace(ROW, start_pose={"x": number, "name": "\ud83d\x00", "y": 1}))
    found = await store.session("s1")
    assert found is not None
    assert found.start_pose is not None
    assert found.start_pose["y"] == 1


@pytest.mark.parametrize("text", ODD_TEXTS)
async def test_any_text_can_be_kept_and_looked_for(store: Store, text: str) -> None:
    columns = ("owner", "title", "cwd", "mode", "model")
    kept = replace(ROW, **dict.fromkeys(columns, text.replace("\x00", "").replace("\ud83d", "?")))  # type: ignore[arg-type]
    await store.add_session(replace(ROW, **dict.fromkeys(columns, text)))  # type: ignore[arg-type] # all are text
    assert await store.session("s1") == kept
    await store.append([event(1)], {"s1": dict.fromkeys(columns, text)})
    assert await listed(store, owner=text) == ["s1"]
    assert await store.session("s1") == kept


@pytest.mark.parametrize("made_up", ["s1\x00", "\x00", "s1\ud83d", "", "x" * 10_000, "🤖"])
async def test_an_id_that_a_client_made_up_is_that_of_no_session(store: Store, made_up: str) -> None:
    await store.add_session(ROW)
    await store.append([event(1)])
    assert await store.session(made_up) is None
    assert len(await store.sessions(None, (NOW + 1, made_up), 10)) == 1


# Events


@pytest.mark.parametrize("text", ODD_TEXTS)
async def test_the_bytes_of_an_event_come_back(store: Store, text: str) -> None:
    await store.add_session(ROW)
    await store.append([event(1, text)])
    [kept] = [kept async for kept in store.events("s1")]
    assert kept == event(1, text)
    assert kept.time == NOW, "to the last bit"


async def test_events_come_in_order_between_two_numbers_whatever_the_pages(store: Store) -> None:
    await store.add_session(ROW)
    await store.add_session(replace(ROW, id="s2"))
    last = 3 * store_module._PAGE + 7
    await store.append([event(seq) for seq in range(last, 0, -1)] + [event(1, session="s2")])
    assert await numbers(store) == list(range(1, last + 1))
    assert await numbers(store, after=5, upto=store_module._PAGE + 6) == list(range(6, store_module._PAGE + 7))
    assert await numbers(store, after=last) == []
    assert await numbers(store, "s2") == [1]


async def test_a_page_of_large_events_is_a_short_one(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store_module, "_PAGE_BYTES", 10_000)
    read, pages = store._page, []

    def counted(*arguments: Any) -> Any:
        pages.append(read(*arguments))
        return pages[-1]

    monkeypatch.setattr(store, "_page", counted)
    await store.add_session(ROW)
    sizes = [1, 4000, 50_000, 1, 50_000, *[1] * 2 * store_module._PAGE]
    await store.append([event(seq, "x" * size) for seq, size in enumerate(sizes, 1)])
    assert await numbers(store) == list(range(1, len(sizes) + 1))
    assert [len(page) for page in pages][:2] == [3, 2]
    assert all(sum(len(row.update) for row in page[:-1]) < 10_000 for page in pages)


async def test_deleting_a_session_removes_its_events_and_no_others(store: Store, database: Database) -> None:
    for session in ("s1", "s2"):
        await store.add_session(replace(ROW, id=session))
        await store.append([event(1, session=session)])
    await store.delete_session("s1")
    assert await listed(store) == ["s2"]
    assert database.execute("SELECT session_id FROM events") == [("s2",)]


async def test_a_write_is_whole_or_not_at_all(store: Store) -> None:
    await store.add_session(ROW)
    wrong = replace(event(2), time=None)  # type: ignore[arg-type] # the database refuses it
    with pytest.raises(IntegrityError):
        await store.append([event(1), wrong], {"s1": {"title": "Tea"}})
    assert await numbers(store) == []
    assert await store.session("s1") == ROW


async def test_a_commit_whose_answer_was_lost_can_be_repeated(store: Store) -> None:
    await store.add_session(ROW)
    await store.append([event(1), event(2)])
    await store.append([event(1), event(2), event(3)], {"s1": {"title": "Tea"}})
    assert await numbers(store) == [1, 2, 3]
    found = await store.session("s1")
    assert found is not None
    assert found.title == "Tea"


async def test_a_number_that_another_program_gave_is_no_repetition(store: Store) -> None:
    await store.add_session(ROW)
    await store.append([event(1, "theirs")])
    with pytest.raises(StoreError, match="Another program has written to the session s1"):
        await store.append([event(1, "ours"), event(2)])
    assert [kept.update["text"] async for kept in store.events("s1")] == ["theirs"]


async def test_events_of_a_session_that_was_deleted_keep_no_others_from_being_kept(store: Store) -> None:
    await store.add_session(ROW)
    await store.append([event(1, session="deleted"), event(1)], {"deleted": {"title": "Tea"}})
    assert await numbers(store) == [1]
    assert await numbers(store, "deleted") == []


# The list


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


# Several programs


async def test_a_second_agent_is_refused_and_comes_in_when_the_first_is_gone(
    database: Database, impatient: None
) -> None:
    first, second = Store(database.url), Store(database.url)
    await first.open()
    with pytest.raises(StoreError, match="Another agent is using the database of sessions"):
        await second.open()
    await first.add_session(ROW)
    await first.close()
    third = Store(database.url)
    await third.open()
    assert await third.session("s1") == ROW
    await third.close()


async def test_an_agent_waits_a_moment_for_the_one_before_it_to_be_gone(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    take, tries = database_module._take, []

    def counted(lock: Any) -> None:
        take(lambda: bool(tries.append(lock) or lock()))

    monkeypatch.setattr(database_module, "_take", counted)
    first, second = Store(database.url), Store(database.url)
    await first.open()
    opening = asyncio.create_task(second.open())
    await eventually(lambda: len(tries) > 2, "the second to try again")
    await first.close()
    await opening
    await second.add_session(ROW)
    await second.close()


async def test_readers_beside_a_writer_see_every_event_once_and_in_order(store: Store, database: Database) -> None:
    last = 600
    await store.add_session(ROW)
    await store.append([event(1)])

    async def write() -> None:
        for seq in range(2, last + 1):
            await store.append([event(seq)])

    async def read() -> list[int]:
        reader = Store(database.url, writes=False)
        await reader.open()
        seen: list[int] = []
        while len(seen) < last:
            seen += await numbers(reader, after=seen[-1] if seen else 0)
        await reader.close()
        return seen

    async with asyncio.timeout(60), asyncio.TaskGroup() as group:
        group.create_task(write())
        readers = [group.create_task(read()) for _ in range(3)]
    for reader in readers:
        assert reader.result() == list(range(1, last + 1))


async def test_a_database_of_another_version_is_told_and_left_alone(database: Database) -> None:
    database.execute("CREATE TABLE sessions (id VARCHAR(64) PRIMARY KEY, updated FLOAT)")
    database.execute("INSERT INTO sessions VALUES ('s1', 0)")
    store = Store(database.url)
    with pytest.raises(StoreError, match="was made by another version of robot-acp: sessions has no created, cwd"):
        await store.open()
    assert database.execute("SELECT id FROM sessions") == [("s1",)]


async def test_what_people_said_is_in_no_error(store: Store, database: Database) -> None:
    database.execute("DROP TABLE events")
    with pytest.raises(DatabaseError) as caught:
        await store.append([event(1, "a secret")], {"s1": {"title": "a secret"}})
    assert "events" in str(caught.value)
    assert "secret" not in str(caught.value)


# URLs


@pytest.mark.parametrize(
    ("url", "told"),
    [
        ("sqlite:////proc/none/sessions.db", "cannot be used: No such file or directory"),
        ("nonsense://ana:hunter2@host/db", "begins with no known kind; use sqlite:/// or postgresql://"),
        ("hunter2", "is no URL such as postgresql://NAME:PASSWORD@HOST:5432/DATABASE"),
        ("postgresql://ana:hunter2@host:port/db", "is no URL such as"),
        ("postgresql://ana:hun@ter2@host/db", "write %40 for an @ in the name or the password"),
    ],
)
async def test_a_url_that_cannot_be_used_is_told_without_its_password(url: str, told: str) -> None:
    with pytest.raises(StoreError) as caught:
        await Store(url).open()
    assert told in str(caught.value)
    assert "ter2" not in str(caught.value)


async def test_a_missing_driver_is_told_with_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(StoreError, match=r"pip install 'robot-acp\[postgres\]'"):
        await Store("postgresql://ana:hunter2@127.0.0.1/db").open()


async def test_a_server_that_lets_nobody_in_is_told_without_the_password(postgres: Cluster) -> None:
    url = postgres.url("postgres")
    for wrong, told in (
        (url.replace(PASSWORD, "letmein"), "password authentication failed for user"),
        (url.replace(str(postgres.port), "1"), "port 1 failed: Connection refused"),
        (url.replace("/postgres", "/nowhere"), 'database "nowhere" does not exist'),
        (url + "?colour=letmein", 'invalid connection option "colour"'),
    ):
        with pytest.raises(StoreError) as caught:
            await Store(wrong).open()
        assert told in str(caught.value)
        assert str(caught.value).endswith("Check agent.database.")
        assert "letmein" not in str(caught.value)
        assert PASSWORD not in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("scheme", ["postgresql://", "postgres://", "postgresql+psycopg://"])
async def test_a_postgresql_url_works_as_people_write_it(postgres: Cluster, scheme: str) -> None:
    with postgres.new_database() as database:
        store = Store(database.url.replace("postgresql://", scheme))
        await store.open()
        await store.add_session(ROW)
        assert await store.session("s1") == ROW
        await store.close()


# JSON


@pytest.mark.parametrize(
    ("value", "kept"),
    [
        ({"a": [1, "ä", None, True, 0.5]}, {"a": [1, "ä", None, True, 0.5]}),
        ({"a": "\ud83d"}, {"a": "?"}),
        ({"a": 10**40}, {"a": 1e40}),
        ({"a": 10**400}, {"a": None}),
        ({"a": float("nan"), "b": "\ud83d"}, {"a": None, "b": "?"}),
        ({"a": 2**64 - 1, "b": -(2**63)}, {"a": 2**64 - 1, "b": -(2**63)}),
    ],
)
def test_what_is_no_json_becomes_what_comes_nearest(value: Any, kept: Any) -> None:
    assert json.loads(as_json(value)) == kept
