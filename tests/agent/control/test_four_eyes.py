"""What needs four eyes is somebody else's to allow, each time, whatever anybody chose before."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import pytest

from backend.agent.acp import updates
from backend.agent.control.approvers import Outcome
from backend.agent.robot.mcp_client import McpClient, Tool
from backend.agent.server import _warm_up
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.sessions import Sessions
from backend.agent.sessions.store import Store
from backend.agent.turns.model import OFFLINE_MODEL
from backend.chat.link import LinkError
from backend.identity import Identity, Role
from tests.agent.conftest import Opener
from tests.databases import Database
from tests.processes import Client, Robot, Watched, eventually

SPEAK = Tool("speak", "Speak", {}, "Speak", None, False)


FOUR_EYES = "ROBOT_ACP_AGENT__FOUR_EYES"


async def logged_in(robot: Robot, name: str, role: Role = Role.OPERATOR, **options: object) -> Client:
    client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}", **options)
    login = {"methodId": "token", "_meta": {"robot-acp/token": robot.token(name, role)}}
    await client.link.request("authenticate", login)
    return client


async def test_an_always_from_before_does_not_count(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    with robot.running("robot", "--time-scale", "20", port=robot.robot_port):
        with robot.running("agent", port=robot.agent_port):
            client = await logged_in(robot, "Ana", answer="allow_always")
            session = await client.new()
            await client.prompt("say hello")
            await client.prompt("say hello")
            assert len(client.questions) == 1
            await client.close()
        robot.environment[FOUR_EYES] = '["speak"]'
        with robot.running("agent", port=robot.agent_port):
            client, ben = await logged_in(robot, "Ana"), await logged_in(robot, "Ben")
            await client.load(session)
            await ben.load(session)
            async with robot.watched() as watched:
                for _ in range(2):
                    assert await client.prompt("say hello") == "end_turn"
                assert watched.spoken == ["Hello."] * 2
            assert (len(client.questions), len(ben.questions)) == (0, 2)
            await client.close()
            await ben.close()


@pytest.fixture(scope="module")
def careful(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """A robot whose speech and drives to places need four eyes."""
    robot = Robot(tmp_path_factory.mktemp("data"), {FOUR_EYES: '["speak", "navigate_to_place", "take_photo"]'})
    with robot.at_work("--time-scale", "20", bridge=False):
        yield robot


WISHES = {"speak": "say hello", "navigate_to_place": "go to the reception", "take_photo": "take a photo"}


@asynccontextmanager
async def a_pair(robot: Robot, mode: str, asker: Client) -> AsyncIterator[tuple[Client, Client, Watched]]:
    """The asker, with a session in this mode, and Ben, who watches it and refuses."""
    ben = await logged_in(robot, "Ben", answer="reject_once")
    await asker.new()
    await ben.load(asker.session)
    await asker.link.request("session/set_mode", {"sessionId": asker.session, "modeId": mode})
    async with robot.watched() as watched:
        yield asker, ben, watched
    for client in (asker, ben):
        with suppress(LinkError):
            await client.link.request("logout", {})  # nobody waits for them to come back
        await client.close()


@pytest.mark.parametrize("mode", ["movement", "supervised", "autonomous"])
@pytest.mark.parametrize("tool", list(WISHES))
async def test_no_mode_lets_one_person_do_it(careful: Robot, mode: str, tool: str) -> None:
    async with a_pair(careful, mode, await logged_in(careful, "Ana", Role.SUPERVISOR)) as (ana, ben, watched):
        await ana.prompt(WISHES[tool])
        if (mode, tool) == ("movement", "speak"):
            assert "not allowed in the mode Movement" in str(ana.updates)
            return
        assert (len(ana.questions), len(ben.questions)) == (0, 1)
        assert [option["kind"] for option in ben.questions[0]["params"]["options"]] == ["allow_once", "reject_once"]
        assert "refused by Ben" in str(ana.updates)
        assert watched.spoken == []
        assert not any(state.motion or state.twist.linear for _, state in watched.states)
        ben.answer = "allow_once"
        for _ in range(2):
            await ana.prompt(WISHES[tool])
        assert len(ben.questions) == 3
        if tool == "speak":
            assert watched.spoken == ["Hello."] * 2


async def test_a_client_on_this_machine_without_a_token_is_not_the_second_person(careful: Robot) -> None:
    ana = await logged_in(careful, "Ana", Role.SUPERVISOR)
    await ana.new()
    unproven = await Client.open(f"tcp://127.0.0.1:{careful.agent_port}")
    await unproven.load(ana.session)
    async with careful.watched() as watched:
        assert await ana.prompt("say hello") == "end_turn"
        assert watched.spoken == []
    assert (ana.questions, unproven.questions) == ([], [])
    assert "nobody is there who may allow it" in str(ana.updates)
    await unproven.close()
    await ana.close()


async def test_nor_the_first(careful: Robot) -> None:
    unproven = await Client.open(f"tcp://127.0.0.1:{careful.agent_port}")
    async with a_pair(careful, "autonomous", unproven) as (asker, ben, watched):
        ben.answer = "allow_once"  # Ben's own other connection, as far as anybody knows
        await asker.prompt("say hello")
        assert watched.spoken == []
        assert (asker.questions, ben.questions) == ([], [])
        assert "Log in with a token of your own" in str(asker.updates)


async def test_two_tokens_of_one_person_are_one_person(careful: Robot) -> None:
    ana, again = await logged_in(careful, "Ana"), await logged_in(careful, "Ana")
    await ana.new()
    await again.load(ana.session)
    await ana.prompt("say hello")
    assert (ana.questions, again.questions) == ([], [])
    await ana.close()
    await again.close()


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
        outcome = Outcome(True, "selected", "allow_always", "Ana", "f1")
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


class Speaking(McpClient):
    """A robot with one tool."""

    async def tools(self) -> dict[str, Tool]:
        return {SPEAK.name: SPEAK}


async def test_a_name_in_the_settings_that_no_tool_has_is_reported(caplog: pytest.LogCaptureFixture) -> None:
    robot = Speaking("http://127.0.0.1:1/mcp", absent="There is no robot.")
    await _warm_up(robot, OFFLINE_MODEL, ["speek", "speak"])
    assert caplog.messages == ["agent.four_eyes: the robot has no tool 'speek'"]
