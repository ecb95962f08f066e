"""What needs four eyes is somebody else's to allow, each time, whatever anybody chose before."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from backend.agent.acp import updates
from backend.agent.control.approvers import Outcome
from backend.agent.robot.mcp_client import Tool
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.sessions import Sessions
from backend.agent.sessions.store import Store
from backend.identity import Identity, Role
from tests.agent.conftest import Opener
from tests.databases import Database
from tests.processes import Client, Robot, eventually

SPEAK = Tool("speak", "Speak", {}, "Speak", None, False)


async def test_an_always_from_before_does_not_count(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    address = f"tcp://127.0.0.1:{robot.agent_port}"
    with robot.running("robot", "--time-scale", "20", port=robot.robot_port):
        with robot.running("agent", port=robot.agent_port):
            client = await Client.open(address, answer="allow_always")
            session = await client.new()
            await client.prompt("say hello")
            await client.prompt("say hello")
            assert len(client.questions) == 1
            await client.close()
        robot.environment["ROBOT_ACP_AGENT__FOUR_EYES"] = '["speak"]'
        with robot.running("agent", port=robot.agent_port):
            client, ben = await Client.open(address), await Client.open(address)
            login = {"methodId": "token", "_meta": {"robot-acp/token": robot.token("Ben", Role.OPERATOR)}}
            await ben.link.request("authenticate", login)
            await client.load(session)
            await ben.load(session)
            async with robot.watched() as watched:
                for _ in range(2):
                    assert await client.prompt("say hello") == "end_turn"
                assert watched.spoken == ["Hello."] * 2
            assert (len(client.questions), len(ben.questions)) == (0, 2)
            await client.close()
            await ben.close()


async def test_nobody_has_allowed_anything_in_a_fork(connect: Opener) -> None:
    client = await connect(answer="allow_always")
    session = await client.new()
    await client.prompt("say hello")
    answer = await client.link.request("session/fork", {"sessionId": session, "cwd": "/", "mcpServers": []})
    client.session, client.answer = answer["sessionId"], None
    turn = client.later(client.prompt("say hello"))
    await eventually(lambda: len(client.questions) == 2, "the question in the fork")
    await client.decide("reject_once")
    assert await turn == "end_turn"
    assert answer["_meta"]["robot-acp/remembered"] == {}


@asynccontextmanager
async def wiring(database: Database) -> AsyncIterator[Sessions]:
    """The sessions of an agent, from its start to its end."""
    store = Store(database.url)
    await store.open()
    journal = Journal(store)
    running = asyncio.create_task(journal.run())
    yield Sessions(store, journal, None, "pose", 1.0)  # type: ignore[arg-type] # no tool is called
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    await store.close()


async def test_nor_after_a_restart(database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    async def nowhere(_: Sessions) -> None:
        return None

    monkeypatch.setattr(Sessions, "robot_pose", nowhere)
    async with wiring(database) as sessions:
        session = await sessions.create("Ana", "/", "supervised", "offline/commands")
        outcome = Outcome(True, "selected", "allow_always", "Ana")
        session.record(updates.user_message(updates.text_block("say hello"), "Ana", "t"))
        session.record(updates.tool_call("t.1", SPEAK, {}, "pending"))
        session.record(updates.tool_status("t.1", "completed", outcome=outcome))
        session.record(updates.turn_ended("t", "end_turn"))
        fork = await sessions.fork(session, "Ben")
        fork.record(updates.message("What comes next."))
        await fork.flushed()
        assert (session.remembered, fork.remembered) == ({"speak": True}, {})
    async with wiring(database) as sessions:
        again = [await sessions.get(one.id, Identity("Sue", Role.SUPERVISOR)) for one in (session, fork)]
        assert [one and one.remembered for one in again] == [{"speak": True}, {}]
        assert again[1] is not None
        assert again[1].seq == session.seq + 2
