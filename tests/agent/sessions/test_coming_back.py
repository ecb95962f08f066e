"""A page that is loaded again answers nothing by that: the question of its session is there when it is back."""

from __future__ import annotations

import asyncio
import contextlib
import functools
from collections.abc import AsyncIterator, Iterator

import pytest

from backend import config
from backend.agent import server
from backend.agent.sessions.sessions import Sessions
from backend.identity import Role
from tests.processes import Client, Robot, eventually, listens


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """The robot server; each test has the agent in its own process, and says for how long people are expected back."""
    robot = Robot(tmp_path_factory.mktemp("data"))
    with robot.running("robot", "--time-scale", "20", port=robot.robot_port):
        yield robot


@pytest.fixture
async def agent(robot: Robot, grace_s: float, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[None]:
    """The agent at work; it expects people back for `grace_s` seconds."""
    monkeypatch.setattr(server, "Sessions", functools.partial(Sessions, grace_s=grace_s))
    ports = {"robot": {"port": robot.robot_port}, "agent": {"port": robot.agent_port}}
    serving = asyncio.create_task(server.serve(config.load(data_dir=robot.data, **ports)))
    await eventually(lambda: listens(robot.agent_port), "the agent to answer")
    yield
    serving.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await serving


async def page(robot: Robot, name: str, role: Role) -> Client:
    client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}", answer=None)
    token = {"robot-acp/token": robot.token(name, role)}
    await client.link.request("authenticate", {"methodId": "token", "_meta": token})
    return client


@pytest.fixture
async def vera(robot: Robot, agent: None) -> AsyncIterator[Client]:
    """A visitor with a session of her own."""
    client = await page(robot, "Vera", Role.VISITOR)
    await client.new()
    yield client
    await client.close()


@pytest.fixture
async def sue(robot: Robot, vera: Client) -> Client:
    """A supervisor who watches the visitor's session, and nobody else does."""
    client = await page(robot, "Sue", Role.SUPERVISOR)
    await client.load(vera.session)
    return client


@pytest.mark.parametrize("grace_s", [600.0])
async def test_whoever_loads_the_page_again_finds_the_question(robot: Robot, vera: Client, sue: Client) -> None:
    turn = vera.later(vera.prompt("say hello"))
    await eventually(lambda: sue.questions, "the question")
    await sue.close()
    back = await page(robot, "Sue", Role.SUPERVISOR)
    await back.load(vera.session)
    await eventually(lambda: back.questions, "the question, put anew")
    assert back.questions[0]["params"] == sue.questions[0]["params"]
    async with robot.watched() as watched:
        await back.decide("allow_once")
        assert await turn == "end_turn"
        assert watched.spoken == ["Hello."]
    await back.close()


@pytest.mark.parametrize("grace_s", [0.05])
async def test_a_question_for_whoever_does_not_come_back_ends(vera: Client, sue: Client) -> None:
    turn = vera.later(vera.prompt("say hello"))
    await eventually(lambda: sue.questions, "the question")
    await sue.close()
    assert await turn == "end_turn"
    assert "nobody is there who may allow it" in vera.said
