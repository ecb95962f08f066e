"""A session is deleted whole, whoever leaves meanwhile, or it stays as it was."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path

import pytest

from backend.agent.robot.mcp_client import McpClient
from backend.agent.sessions.database import StoreError
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.sessions import Sessions
from backend.agent.sessions.store import Event, Store, as_json
from backend.chat.link import RefusedError
from backend.identity import Identity, Role
from tests.agent.conftest import Opener
from tests.agent.sessions.stores import NOW, ROW, event, listed
from tests.databases import Database, SQLite
from tests.processes import PATIENCE_S, Robot, eventually

ANA = Identity("Ana", Role.OPERATOR)


async def test_who_deletes_and_leaves_at_once_leaves_nothing_behind(robot: Robot, connect: Opener) -> None:
    other = await connect(robot.token("Olga", Role.SUPERVISOR))

    async def ids() -> set[str]:
        return {one["sessionId"] for one in (await other.link.request("session/list", {}))["sessions"]}

    before = await ids()
    for _ in range(20):
        client = await connect(robot.token("Ana", Role.OPERATOR))
        session = await client.new()
        await client.prompt("/where")
        await client.link._send({"id": 99, "method": "session/delete", "params": {"sessionId": session}})
        await client.close()
    async with asyncio.timeout(PATIENCE_S):
        while await ids() != before:
            await asyncio.sleep(0.01)
    with pytest.raises(RefusedError, match="There is no session"):
        await other.load(session)


@pytest.fixture
async def sessions(store: Store) -> AsyncIterator[Sessions]:
    """All sessions of an agent without a robot."""
    journal = Journal(store, retry_s=0.01)
    running = asyncio.create_task(journal.run())
    nowhere = McpClient("http://127.0.0.1:1/mcp", absent="There is no robot.")
    yield Sessions(store, journal, nowhere, "get_current_pose", 1.0)
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


async def test_a_delete_that_is_cancelled_goes_on(store: Store, sessions: Sessions) -> None:
    session = await sessions.create("Ana", "/", "observe", "offline/commands")
    session.record({"sessionUpdate": "session_info_update"})
    deleting = asyncio.create_task(sessions.delete(session))
    await asyncio.sleep(0)
    deleting.cancel()
    await asyncio.gather(deleting, return_exceptions=True)
    assert deleting.cancelled()

    async def gone() -> bool:
        return await store.session(session.id) is None

    async with asyncio.timeout(PATIENCE_S):
        while not await gone():
            await asyncio.sleep(0.005)
    await eventually(lambda: session.id not in sessions._open, "the session to be forgotten")
    assert await listed(store) == []


async def test_a_session_that_cannot_be_deleted_stays_as_it_was(
    store: Store, sessions: Sessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = await sessions.create("Ana", "/", "observe", "offline/commands")

    async def away(_session_id: str) -> None:
        raise StoreError("The database is away.")

    with monkeypatch.context() as patch:
        patch.setattr(store, "delete_session", away)
        with pytest.raises(StoreError):
            await sessions.delete(session)
    assert await sessions.get(session.id, ANA) is session
    await sessions.delete(session)
    assert await sessions.get(session.id, ANA) is None


async def test_a_long_session_is_deleted_in_pieces_and_no_other_is_touched(store: Store) -> None:
    store.page_bytes = 10_000
    for name in ("s1", "s2"):
        await store.add_session(replace(ROW, id=name))
        await store.append([event(seq, "x" * 1000, name) for seq in range(1, 501)])
    await store.delete_session("s1")
    assert await store.session("s1") is None
    assert [e async for e in store.events("s1")] == []
    assert len([e async for e in store.events("s2")]) == 500


async def test_a_fork_has_the_whole_past_and_none_of_the_answers(store: Store, sessions: Sessions) -> None:
    store.page_bytes = 1000
    session = await sessions.create("Ana", "/", "observe", "offline/commands")
    for number in range(50):
        session.record({"sessionUpdate": "agent_message_chunk", "content": {"type": "text", "text": f"{number} " * 50}})
    session.record({"sessionUpdate": "session_info_update", "_meta": {"robot-acp/turn": {"id": "t", "state": "ended"}}})
    session.record({"sessionUpdate": "agent_message_chunk", "content": {"type": "text", "text": "a turn that runs"}})
    fork = await sessions.fork(session, "Ben", "/home/ben")
    assert (fork.row.owner, fork.row.cwd, fork.seq) == ("Ben", "/home/ben", 52)
    original = [e.raw async for e in store.events(session.id)]
    copied = [e.raw async for e in store.events(fork.id)]
    assert copied[:51] == original[:51]
    assert b"robot-acp/forked" in copied[51]
    assert not sessions._hidden


async def test_space_of_what_is_deleted_goes_back_to_the_disk(tmp_path: Path) -> None:
    database = SQLite(tmp_path / "sessions.db")
    store = Store(database.url)
    await store.open()
    journal = Journal(store)
    running = asyncio.create_task(journal.run())
    nowhere = McpClient("http://127.0.0.1:1/mcp", absent="There is no robot.")
    sessions = Sessions(store, journal, nowhere, "get_current_pose", 1.0)
    await store.add_session(ROW)
    said = {"sessionUpdate": "agent_message_chunk", "content": {"type": "text", "text": "x" * 1_000_000}}
    for seq in range(1, 41):
        await store.append([Event("s1", seq, NOW, as_json(said))])
    session = await sessions.get("s1", ANA)
    assert session is not None

    def size() -> int:
        return sum(file.stat().st_size for file in tmp_path.iterdir())

    assert size() > 40_000_000
    await sessions.delete(session)
    await eventually(lambda: size() < 6_000_000, "the file to become small")
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    await sessions.close()
    await store.close()


async def test_a_file_of_an_older_version_learns_to_give_space_back(tmp_path: Path) -> None:
    database = SQLite(tmp_path / "sessions.db")
    database.execute("PRAGMA auto_vacuum=NONE")
    database.execute("CREATE TABLE unrelated (a)")
    store = Store(database.url)
    await store.open()
    await store.close()
    assert database.execute("PRAGMA auto_vacuum") == [(2,)]


async def test_two_who_delete_the_same_session_are_both_told_that_it_is_gone(
    database: Database, sessions: Sessions
) -> None:
    session = await sessions.create("Ana", "/", "observe", "offline/commands")
    await asyncio.gather(sessions.delete(session), sessions.delete(session))
    assert database.execute("SELECT id FROM sessions") == []
