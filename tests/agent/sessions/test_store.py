"""The store does the same on every database: what it keeps of a session and its events, and what it refuses."""

from __future__ import annotations

import asyncio
import json
from dataclasses import replace
from typing import Any

import pytest
from sqlalchemy.exc import DatabaseError, IntegrityError

from backend.agent.sessions import store as store_module
from backend.agent.sessions.store import Store, StoreError, as_json
from tests.agent.sessions.stores import NOW, ODD_TEXTS, ROW, event, listed, numbers
from tests.databases import Database

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
    store.page_bytes = 10_000
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


async def test_what_people_said_is_in_no_error(store: Store, database: Database) -> None:
    database.execute("DROP TABLE events")
    with pytest.raises(DatabaseError) as caught:
        await store.append([event(1, "a secret")], {"s1": {"title": "a secret"}})
    assert "events" in str(caught.value)
    assert "secret" not in str(caught.value)


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
