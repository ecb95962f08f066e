"""What happens to events when the database does not take them, and who waits for whom."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy.exc import OperationalError

from backend.agent import journal as journal_module
from backend.agent.history import History
from backend.agent.journal import Journal
from backend.agent.session import Session
from backend.agent.store import Event, SessionRow, Store
from tests.processes import eventually

ROW = SessionRow("s1", "Ana", None, "/", "supervised", "offline/commands", None, 0.0, 0.0)


class Moody(Store):
    """A real store whose writes fail while the test says so."""

    broken = False
    gate: asyncio.Event | None = None

    async def append(self, events: Any) -> None:
        if self.gate:
            await self.gate.wait()
        if self.broken:
            raise OperationalError("insert", {}, Exception("database is locked"))
        await super().append(events)


@asynccontextmanager
async def at_work(tmp_path: Path) -> AsyncIterator[tuple[Moody, Journal, Session]]:
    store = Moody(f"sqlite:///{tmp_path / 'sessions.db'}")
    await store.open()
    await store.add_session(ROW)
    journal = Journal(store)
    running = asyncio.create_task(journal.run())
    yield store, journal, Session(ROW, journal, History(), 0, 1.0, asyncio.create_task)  # type: ignore[arg-type]
    assert not running.done()
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    await store.close()


def message(text: str) -> dict[str, Any]:
    return {"sessionUpdate": "agent_message_chunk", "content": {"type": "text", "text": text}}


async def kept(store: Store) -> list[str]:
    return [event.update["content"]["text"] async for event in store.events("s1")]


async def test_what_could_not_be_written_is_written_when_it_can_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journal_module, "RETRY_S", 0.01)
    async with at_work(tmp_path) as (store, journal, session):
        shown: list[int] = []
        store.broken = True
        session.record(message("one"))
        journal.append(Event("s1", 2, 0.0, b'{"content":{"text":"two"}}'), lambda event: shown.append(event.seq))
        await journal.flush()
        assert shown == [2], "people go on seeing what happens"
        assert journal.failure is not None
        assert "cannot be written" in journal.failure
        assert "locked" not in journal.failure
        store.broken = False
        await eventually(lambda: journal.failure is None, "the next try")
        assert await kept(store) == ["one", "two"]


async def test_a_flush_waits_for_what_was_before_it_alone(tmp_path: Path) -> None:
    async with at_work(tmp_path) as (store, journal, session):
        store.gate = asyncio.Event()
        session.record(message("before"))
        flushed = asyncio.create_task(journal.flush())
        await eventually(lambda: journal._flushes, "the flush to wait")
        store.gate.set()
        store.gate = None
        session.record(message("after"))
        await flushed
        assert (await kept(store))[0] == "before"


@pytest.mark.parametrize("text", ["half a character \ud83d", "NUL \x00", "𝄞"])
async def test_no_text_ends_the_journal(tmp_path: Path, text: str) -> None:
    async with at_work(tmp_path) as (store, journal, session):
        session.record(message(text))
        session.record(message("next"))
        await journal.flush()
        assert (await kept(store))[1] == "next"


async def test_no_number_ends_the_journal(tmp_path: Path) -> None:
    async with at_work(tmp_path) as (store, journal, session):
        session.record(message("a") | {"rawInput": {"degrees": 10**40}})
        await journal.flush()
        assert await kept(store) == ["a"]
