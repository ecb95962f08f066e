"""What happens to events when the database does not take them, and who waits for whom."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import AbstractContextManager, asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import orjson
import pytest

from backend.agent.robot.mcp_client import McpClient
from backend.agent.sessions import journal as journal_module
from backend.agent.sessions.history import History
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.session import Session
from backend.agent.sessions.sessions import Sessions
from backend.agent.sessions.store import Event, SessionRow, Store
from tests.databases import Cluster, Database, SQLite
from tests.processes import PATIENCE_S, eventually

ROW = SessionRow("s1", "Ana", None, "/", "supervised", "offline/commands", None, 0.0, 0.0)


@dataclass
class Work:
    """A session that is recorded in a real database, and what was shown of it."""

    store: Store
    journal: Journal
    session: Session
    shown: list[int] = field(default_factory=list)

    def tell(self, text: str) -> None:
        self.session.record(message(text))

    async def kept(self) -> list[str]:
        return [event.update["content"]["text"] async for event in self.store.events("s1")]

    @contextmanager
    def hurried(self, trouble: AbstractContextManager[None]) -> Iterator[None]:
        """While the database is in trouble, the journal loses patience soon."""
        self.journal.patience_s = 0.2
        with trouble:
            yield
        self.journal.patience_s = PATIENCE_S

    async def recovered(self) -> None:
        await eventually(lambda: self.journal.failure is None, "the next try")


@asynccontextmanager
async def at_work(database: Database) -> AsyncIterator[Work]:
    store = Store(database.url)
    await store.open()
    await store.add_session(ROW)
    journal = Journal(store, retry_s=0.01, patience_s=PATIENCE_S)  # a slow disk is no failure
    running = asyncio.create_task(journal.run())
    session = Session(ROW, journal, History(), 0, 1.0, asyncio.create_task)  # type: ignore[arg-type]
    work = Work(store, journal, session)
    await session.attach(Watcher(work.shown))
    yield work
    assert not running.done()
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    await store.close()


@dataclass(eq=False)
class Watcher:
    """A client that is shown events."""

    shown: list[int]
    may_approve: bool = False
    can_write_files: bool = False
    can_show_forms: bool = False

    def deliver(self, frame: bytes) -> None:
        self.shown.append(orjson.loads(frame)["params"]["_meta"]["robot-acp/seq"])

    async def wait_for_space(self) -> None:
        pass


def message(text: str) -> dict[str, Any]:
    return {"sessionUpdate": "agent_message_chunk", "content": {"type": "text", "text": text}}


async def test_what_could_not_be_written_is_shown_and_written_when_it_can_be(database: Database) -> None:
    async with at_work(database) as work:
        work.tell("before")
        await work.session.flushed()
        with work.hurried(database.away()):
            work.tell("one")
            work.tell("two")
            await work.session.flushed()
            assert work.shown == [1, 2, 3], "people go on seeing what happens"
            assert work.journal.failure is not None
            assert "The session log cannot be written" in work.journal.failure
            assert "hunter2" not in work.journal.failure
            work.tell("three")
            assert work.shown == [1, 2, 3, 4], "and wait for no further try"
        await work.recovered()
        assert await work.kept() == ["before", "one", "two", "three"]
        work.tell("after")
        await work.session.flushed()
        assert await work.kept() == ["before", "one", "two", "three", "after"]
        assert work.shown == [1, 2, 3, 4, 5]


async def test_a_write_that_hangs_hides_nothing_and_is_kept_once_whenever_it_ends(database: Database) -> None:
    async with at_work(database) as work:
        with work.hurried(database.hanging()):
            work.tell("one")
            await eventually(lambda: not work.journal._unkept, "the write to be under way")
            work.tell("two")
            await eventually(lambda: work.journal.failure, "the journal to lose patience")
            assert work.shown == [1, 2]
            work.tell("three")
            assert work.shown == [1, 2, 3]
        # The write of "one" is still under way in the database, and it will be repeated.
        await work.recovered()
        assert await work.kept() == ["one", "two", "three"]


async def test_much_is_written_in_pieces_and_each_is_shown_when_it_is_kept(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with at_work(database) as work:
        append, pieces = work.store.append, []

        async def counted(events: Sequence[Event], changes: Any = None) -> None:
            assert len(work.shown) == sum(map(len, pieces)), "the pieces before are shown, and nothing else"
            await append(events, changes)
            pieces.append(list(events))

        monkeypatch.setattr(work.store, "append", counted)
        for number in range(1000):
            work.tell(f"{number}")
        for _ in range(4):
            work.tell("x" * journal_module.PIECE_BYTES)
        await work.session.flushed()
        assert max(len(piece) for piece in pieces) == journal_module.PIECE_EVENTS
        assert all(sum(len(e.raw) for e in piece[:-1]) < journal_module.PIECE_BYTES for piece in pieces)
        assert len(pieces) >= 8
        assert work.shown == list(range(1, 1005))
        assert len(await work.kept()) == 1004


async def test_a_write_that_takes_long_is_awaited_and_not_sent_again(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with at_work(database) as work:
        append, calls, may_go_on = work.store.append, [], asyncio.Event()

        async def slow(events: Sequence[Event], changes: Any = None) -> None:
            calls.append([event.seq for event in events])
            await may_go_on.wait()
            await append(events, changes)

        monkeypatch.setattr(work.store, "append", slow)
        work.journal.patience_s = 0.01
        work.tell("one")
        await eventually(lambda: work.journal.failure, "the journal to lose patience")
        work.tell("two")
        for _ in range(3):
            await work.session.flushed()  # each is one round of the journal
            work.tell("more")
        assert calls == [[1]]
        work.journal.patience_s = PATIENCE_S
        may_go_on.set()
        await work.recovered()
        await work.session.flushed()
        assert calls == [[1], [2, 3, 4, 5]]
        assert await work.kept() == ["one", "two", "more", "more", "more"]


async def test_the_log_of_the_agent_says_once_that_the_database_is_away(
    database: Database, caplog: pytest.LogCaptureFixture
) -> None:
    async with at_work(database) as work:
        told: list[str | None] = []
        unwatch = work.journal.watch(lambda: told.append(work.journal.failure))
        with work.hurried(database.away()):
            work.tell("one")
            await eventually(lambda: work.journal.failure, "the failure")
            for _ in range(3):
                work.tell("more")
                await work.session.flushed()
        await work.recovered()
        unwatch()
        said = [record.getMessage() for record in caplog.records if record.name.endswith("journal")]
        assert len(said) == 2, said
        assert "cannot be written, and I try again" in said[0]
        assert "can be written again" in said[1]
        assert [failure is None for failure in told] == [False, True]


async def test_a_database_that_is_away_is_noticed_though_nobody_writes(postgres: Cluster) -> None:
    with postgres.new_database() as database:
        async with at_work(database) as work:
            work.journal.probe_s = 0.05
            work.tell("one")
            await work.session.flushed()
            with database.away():
                await eventually(lambda: work.journal.failure, "the journal to notice")
            await work.recovered()


@pytest.mark.slow
async def test_a_replay_while_the_log_cannot_be_written_has_no_gap(tmp_path: Path) -> None:
    database = SQLite(tmp_path / "sessions.db")
    async with at_work(database) as work:
        nowhere = McpClient("http://127.0.0.1:1/mcp", absent="There is no robot.")
        sessions = Sessions(work.store, work.journal, nowhere, "get_current_pose", 1.0)

        async def replayed(after: int) -> list[int]:
            seen: list[int] = []
            replay = sessions.replay
            await work.session.attach(Watcher(seen), lambda upto: replay(work.session, after, upto))
            return seen

        work.tell("before")
        await work.session.flushed()
        with work.hurried(database.away()):
            work.tell("one")
            await eventually(lambda: work.journal.failure, "the failure")
            work.tell("two")
            assert await replayed(0) == [1, 2, 3]
            await eventually(lambda: work.journal._keeping, "the next try")
            assert await replayed(0) == [1, 2, 3], "what is being written is not forgotten"
            assert await replayed(2) == [3]
        await work.recovered()
        assert await replayed(0) == [1, 2, 3]


async def test_changes_that_could_not_be_written_are_none_lost(database: Database) -> None:
    async with at_work(database) as work:
        with work.hurried(database.away()):
            work.session.change(title="Tea", mode="observe")
            await eventually(lambda: work.journal.failure, "the failure")
            work.session.change(mode="plan")
        await work.recovered()
        await work.session.flushed()
        found = await work.store.session("s1")
        assert found is not None
        assert (found.title, found.mode) == ("Tea", "plan")


async def test_a_flush_waits_for_what_was_before_it_alone(database: Database) -> None:
    async with at_work(database) as work:
        with database.hanging():
            work.tell("before")
            flushed = asyncio.create_task(work.session.flushed())
            await eventually(lambda: work.journal._flushes and not work.journal._unkept, "the write to be under way")
            assert work.shown == [], "durable before visible"
        work.tell("after")
        await flushed
        assert (await work.kept())[0] == "before"
        assert work.shown[0] == 1


async def test_an_event_of_a_session_that_was_deleted_stops_nobody(database: Database) -> None:
    async with at_work(database) as work:
        work.journal.append(Event("gone", 1, 0.0, b"{}"), lambda _event: None)
        work.tell("here")
        await work.session.flushed()
        assert work.journal.failure is None
        assert await work.kept() == ["here"]


@pytest.mark.parametrize("text", ["half a character \ud83d", "NUL \x00", "𝄞"])
async def test_no_text_ends_the_journal(database: Database, text: str) -> None:
    async with at_work(database) as work:
        work.tell(text)
        work.session.change(title=text)
        work.tell("next")
        await work.session.flushed()
        assert work.journal.failure is None
        assert (await work.kept())[1] == "next"


async def test_no_number_ends_the_journal(database: Database) -> None:
    async with at_work(database) as work:
        work.session.record(message("a") | {"rawInput": {"degrees": 10**40}})
        await work.session.flushed()
        assert await work.kept() == ["a"]


async def test_connections_that_the_server_ended_are_made_again_and_nobody_notices(postgres: Cluster) -> None:
    with postgres.new_database() as database:
        async with at_work(database) as work:
            for number in range(3):
                work.tell(f"{number}")
                await work.session.flushed()
                assert database.cut_connections() == 1
            assert work.journal.failure is None
            assert await work.kept() == ["0", "1", "2"]


async def test_what_was_under_way_when_the_server_ended_the_connection_is_written_again(postgres: Cluster) -> None:
    with postgres.new_database() as database:
        async with at_work(database) as work:
            with database.hanging():
                work.tell("one")
                work.session.change(title="Tea", mode="observe")
                await eventually(lambda: not work.journal._changes, "the write to be under way")
                work.session.change(mode="plan")
                assert database.cut_connections() == 1
                await eventually(lambda: work.journal.failure, "the failure")
            await work.recovered()
            await work.session.flushed()
            found = await work.store.session("s1")
            assert found is not None
            assert (found.title, found.mode) == ("Tea", "plan")
            assert await work.kept() == ["one"]


async def test_an_agent_that_lost_its_database_to_another_writes_nothing_into_it(
    postgres: Cluster, impatient: None
) -> None:
    with postgres.new_database() as database:
        async with at_work(database) as work:
            with database.away():
                pass
            other = Store(database.url)
            await other.open()
            work.tell("mine")
            await work.session.flushed()
            assert work.journal.failure is not None
            assert "Another agent is using the database" in work.journal.failure
            assert [event.seq async for event in other.events("s1")] == []
            await other.close()
            await work.recovered()
            assert await work.kept() == ["mine"]
