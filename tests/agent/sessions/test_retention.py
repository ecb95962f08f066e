"""What a login may have kept, and what goes first when it is old or too much."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass, replace
from typing import Any

import pytest

from backend.agent.acp import updates
from backend.agent.robot.mcp_client import McpClient, ToolResult
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.media import without_media
from backend.agent.sessions.retention import EMPTY_S, QuotaExceeded, Retention
from backend.agent.sessions.sessions import Sessions
from backend.agent.sessions.store import Event, Store, as_json
from backend.agent.sessions.usage import Usage
from backend.config import Storage
from backend.identity import Identity, Role, person_named
from tests.agent.sessions.stores import ROW, listed
from tests.agent.sessions.test_journal import Watcher

ANA = Identity("Ana", Role.OPERATOR)
KIOSK = Identity("Kiosk", Role.VISITOR)
DAY_S = 86400.0
PHOTO = {"type": "image", "mimeType": "image/jpeg", "data": "A" * 50_000}


@dataclass
class Kept:
    """The database of an agent without a robot, and its limits."""

    store: Store
    journal: Journal
    sessions: Sessions
    usage: Usage

    def limited(self, **limits: Any) -> Retention:
        return Retention(self.store, self.sessions, self.usage, Storage(**limits))

    async def old(self, name: str, days: float, *update: dict[str, Any], owner: str = "Ana") -> None:
        """A session whose last event is so old."""
        then = time.time() - days * DAY_S
        await self.store.add_session(replace(ROW, id=name, owner=owner, created=then, updated=then))
        await self.store.append([Event(name, seq, then, as_json(u)) for seq, u in enumerate(update, 1)])

    async def counted(self) -> None:
        """Count anew, as the agent does when it starts."""
        fresh = Usage()
        await fresh.read(self.store)
        vars(self.usage).update(vars(fresh))


def said(size: int = 100) -> dict[str, Any]:
    return updates.message("x" * size)


def photo() -> dict[str, Any]:
    return updates.tool_result("t.1", ToolResult(False, [PHOTO, updates.text_block("the photo")], {"saved": True}))


@pytest.fixture
async def kept(store: Store) -> AsyncIterator[Kept]:
    usage = Usage()
    journal = Journal(store, retry_s=0.01, count=usage.add_event)
    running = asyncio.create_task(journal.run())
    nowhere = McpClient("http://127.0.0.1:1/mcp", absent="There is no robot.")
    sessions = Sessions(store, journal, nowhere, "get_current_pose", 1.0, usage=usage)
    yield Kept(store, journal, sessions, usage)
    await sessions.close()
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


async def test_what_is_counted_is_what_is_in_the_database(kept: Kept) -> None:
    first = await kept.sessions.create("Ana", "/", "observe", "offline/commands")
    second = await kept.sessions.create("Ben", "/", "observe", "offline/commands")
    for session in (first, second, first):
        session.record(said(5000))
        session.record({"sessionUpdate": "session_info_update", "_meta": {"robot-acp/turn": {"state": "ended"}}})
    await first.flushed()
    await kept.sessions.fork(first, "Cleo")
    await kept.sessions.delete(second)
    counted = {use.id: (use.owner, use.events, use.bytes, use.large_bytes) for use in kept.usage.oldest_first()}
    whole = kept.usage.bytes
    fresh = Usage()
    await fresh.read(kept.store)
    assert {u.id: (u.owner, u.events, u.bytes, u.large_bytes) for u in fresh.oldest_first()} == counted
    assert fresh.bytes == whole > 20_000
    assert [fresh.of_owner(person_named(name)).sessions for name in ("Ana", "Ben", "Cleo")] == [1, 0, 1]


async def test_an_operator_over_the_quota_is_asked_to_delete_and_then_has_room(kept: Kept) -> None:
    retention = kept.limited(operator_bytes=10_000)
    session = await kept.sessions.create("Ana", "/", "observe", "offline/commands")
    await retention.admit(ANA, ANA.person, 4000)
    session.record(said(7000))
    await session.flushed()
    with pytest.raises(QuotaExceeded, match="Delete sessions that are no longer needed"):
        await retention.admit(ANA, ANA.person, 4000)
    await retention.admit(Identity("Ben", Role.OPERATOR), "name:Ben", 4000)  # others have their own
    await retention.admit(Identity("Olga", Role.SUPERVISOR), ANA.person, 4000)  # a supervisor may go on in it
    await kept.sessions.delete(session)
    await retention.admit(ANA, ANA.person, 4000)


async def test_the_number_of_sessions_is_limited_too(kept: Kept) -> None:
    retention = kept.limited(operator_sessions=2)
    for _ in range(2):
        await retention.admit(ANA, ANA.person, 0, new_session=True)
        await kept.sessions.create("Ana", "/", "observe", "offline/commands")
    with pytest.raises(QuotaExceeded, match="in 2 of 2 sessions"):
        await retention.admit(ANA, ANA.person, 0, new_session=True)
    await retention.admit(ANA, ANA.person, 100)  # a prompt in one of them


async def test_a_visitors_oldest_sessions_make_room_and_one_in_use_never_does(kept: Kept) -> None:
    for number in range(5):
        await kept.old(f"old{number}", 5 - number, said(2000), owner="Kiosk")
    await kept.old("ana", 9, said(2000))
    await kept.counted()
    in_use = await kept.sessions.get("old0", KIOSK)
    assert in_use is not None
    await in_use.attach(Watcher([]))
    retention = kept.limited(visitor_bytes=10_000)
    await retention.admit(KIOSK, KIOSK.person, 3000)
    assert sorted(await listed(kept.store)) == ["ana", "old0", "old4"]
    with pytest.raises(QuotaExceeded):
        await retention.admit(KIOSK, KIOSK.person, 9000)


async def enforced(kept: Kept, **limits: Any) -> list[str]:
    await kept.counted()
    await kept.limited(**limits)._enforce(time.time())
    return sorted(use.id for use in kept.usage.oldest_first())


async def test_old_sessions_are_deleted_and_empty_ones_soon(kept: Kept) -> None:
    await kept.old("old", 31, said())
    await kept.old("new", 29, said())
    await kept.old("empty", 2 * EMPTY_S / DAY_S)
    await kept.old("just begun", 0.5 * EMPTY_S / DAY_S)
    assert await enforced(kept) == ["just begun", "new", "old"]
    assert await enforced(kept, session_days=30) == ["just begun", "new"]


async def test_photos_of_old_sessions_go_and_their_words_stay(kept: Kept) -> None:
    await kept.old("old", 31, said(5000), photo())
    await kept.old("new", 29, photo())
    await enforced(kept, media_days=30)
    texts = [event.raw.decode() async for event in kept.store.events("old")]
    assert "This photo is no longer kept" in texts[1]
    assert "the photo" in texts[1]
    assert PHOTO["data"] not in texts[1]
    assert kept.usage.of_session("old") == sum(len(text) for text in texts)
    [new] = [event.raw.decode() async for event in kept.store.events("new")]
    assert PHOTO["data"] in new


async def test_when_there_is_too_much_photos_go_before_sessions_and_the_oldest_first(kept: Kept) -> None:
    for number in range(4):
        await kept.old(f"s{number}", 10 - number, said(20_000), photo())
    assert await enforced(kept, max_bytes=200_000) == ["s0", "s1", "s2", "s3"]
    assert kept.usage.bytes <= 180_000
    with_photos = [s for s in ("s0", "s1", "s2", "s3") if kept.usage.of_session(s) > 50_000]
    assert with_photos == ["s3"] or with_photos == ["s2", "s3"]
    assert await enforced(kept, max_bytes=50_000) == ["s2", "s3"]
    assert await enforced(kept, max_sessions=1) == []  # to nine tenths of the limit


async def test_a_session_in_use_is_never_touched(kept: Kept) -> None:
    await kept.old("old", 99, photo())
    session = await kept.sessions.get("old", ANA)
    assert session is not None
    watcher = Watcher([])
    await session.attach(watcher)
    assert await enforced(kept, session_days=1, media_days=1, max_bytes=1) == ["old"]
    session.detach(watcher)
    assert await enforced(kept, session_days=1) == []
    assert session.deleted
    assert await kept.sessions.get("old", ANA) is None


@pytest.mark.parametrize(
    ("update", "left"),
    [
        (photo(), "photo"),
        (updates.user_message({"type": "audio", "mimeType": "audio/wav", "data": "AAAA"}, "Ana", "t"), "sound"),
        (updates.user_message({"type": "resource", "resource": {"uri": "x:y", "blob": "AA"}}, "Ana", "t"), "file"),
        (updates.user_message(updates.text_block("hello"), "Ana", "t"), None),
        (updates.user_message({"type": "resource", "resource": {"uri": "x:y", "text": "AA"}}, "Ana", "t"), None),
        (updates.tool_status("t.1", "failed", "no"), None),
        (updates.title("Tea"), None),
        ({"sessionUpdate": "plan", "entries": []}, None),
        ({"sessionUpdate": "tool_call_update", "content": [None, {"type": "diff"}]}, None),
    ],
)
def test_only_photos_sounds_and_files_are_taken_out(update: dict[str, Any], left: str | None) -> None:
    without = without_media(as_json(update))
    if left is None:
        assert without is None
    else:
        assert f"[This {left} is no longer kept.]" in (without or b"").decode()
        assert without_media(without or b"") is None
