"""The log of a session, read page by page: what a replay shows, with the times that it shows, nothing for strangers."""

from __future__ import annotations

import asyncio
import time
from types import SimpleNamespace
from typing import Any

import pytest

from backend.agent.acp import extensions
from backend.agent.acp.rights import Rights
from backend.chat.link import RefusedError
from backend.identity import Role
from tests.agent.conftest import Opener
from tests.processes import Client, Robot


async def test_an_event_keeps_its_time_in_every_replay(connect: Opener) -> None:
    before = time.time()
    client = await connect()
    session = await client.new()
    await client.prompt("where are you?")
    archive = await connect()
    await archive.load(session)
    at: dict[int, float] = {e["_meta"]["robot-acp/seq"]: e["_meta"]["robot-acp/at"] for e in archive.events}
    assert [at[event["_meta"]["robot-acp/seq"]] for event in client.events] == [
        event["_meta"]["robot-acp/at"] for event in client.events
    ]
    times = list(at.values())
    assert times == sorted(times)
    assert before <= times[0]
    assert times[-1] <= time.time()


async def page(client: Client, **wanted: Any) -> dict[str, Any]:
    return await client.link.request("_robot/events", {"sessionId": client.session, **wanted})


async def test_the_log_can_be_read_page_by_page_and_is_what_a_replay_shows(connect: Opener) -> None:
    client = await connect()
    session = await client.new()
    await client.prompt("where are you?")
    archive = await connect()
    await archive.load(session)
    shown = [
        {"seq": e["_meta"]["robot-acp/seq"], "at": e["_meta"]["robot-acp/at"], "update": e["update"]}
        for e in archive.events
    ]
    assert await page(client) == {"events": shown, "last": len(shown)}
    assert await page(client, after=2, limit=2) == {"events": shown[2:4], "last": len(shown)}
    assert await page(client, after=len(shown)) == {"events": [], "last": len(shown)}
    for nonsense in ({"after": -1}, {"after": "1"}, {"limit": True}):
        with pytest.raises(RefusedError):
            await page(client, **nonsense)


async def test_who_may_not_see_a_session_reads_nothing_of_its_log(robot: Robot, connect: Opener) -> None:
    client = await connect()
    await client.new()
    await client.prompt("where are you?")
    stranger = await connect(robot.token("Otto", Role.VISITOR))
    with pytest.raises(RefusedError, match="There is no session"):
        await stranger.link.request("_robot/events", {"sessionId": client.session})


class Everyone(Rights):
    """Whoever asks may see every session."""

    def __init__(self) -> None:
        pass

    async def session(self, session_id: str) -> Any:
        return session_id


async def test_a_connection_reads_one_page_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    reading: list[object] = []
    most = 0

    async def read(_: object, session: object, params: dict[str, Any]) -> dict[str, Any]:
        nonlocal most
        reading.append(session)
        most = max(most, len(reading))
        await asyncio.sleep(0)
        reading.remove(session)
        return params

    monkeypatch.setattr(extensions, "event_page", read)
    wiring = SimpleNamespace(sessions=None)
    ours = extensions.Extensions(wiring, Everyone(), lambda _: None)  # type: ignore[arg-type] # nothing else is asked
    asked = [{"sessionId": "s1", "after": after} for after in range(20)]
    assert await asyncio.gather(*(ours.call("robot/events", params) for params in asked)) == asked
    assert most == 1
