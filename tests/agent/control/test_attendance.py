"""No robot moves for nobody: with all who may operate it gone for the time that the settings say, it halts."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from backend.identity import Role
from tests.agent.conftest import Opener, far
from tests.processes import Client, Robot, Watched, eventually

AWAY_S = 1.0
BACK_S = 10.0
"""Long enough to be back in time on a slow machine."""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """A robot at an ordinary pace, so that a drive outlasts what is waited for."""
    robot = Robot(tmp_path_factory.mktemp("data"), {"ROBOT_ACP_AGENT__UNATTENDED_AFTER": str(AWAY_S)})
    with robot.running("robot", port=robot.robot_port), robot.running("agent", port=robot.agent_port):
        yield robot


async def driving(client: Client, watched: Watched, text: str | None = None) -> None:
    """From rest: the last test's robot may still brake, and its drive is not this one."""
    await watched.until(lambda: watched.speed == 0 and not watched.state.motion, "the robot at rest before")
    client.later(client.prompt(text or far(watched)))
    await watched.until(lambda: watched.speed > 0.3, "the robot to drive")


async def test_the_robot_halts_when_the_only_operator_has_gone(robot: Robot, connect: Opener) -> None:
    operator = await connect()
    session = await operator.new()
    async with robot.watched() as watched:
        await driving(operator, watched)
        await operator.close()
        await watched.until(lambda: watched.speed == 0 and not watched.state.motion, "the robot at rest")
    back = await connect()
    await back.load(session)
    stopped = "Nobody who may operate me is connected any more, so I stopped here."
    await eventually(lambda: stopped in back.said, "the reason")
    await eventually(lambda: "robot-acp/turn" in (back.updates[-1].get("_meta") or {}), "the end of the turn")
    assert back.updates[-1]["_meta"]["robot-acp/turn"]["stopReason"] == "cancelled"


async def test_somebody_who_only_watches_is_nobody(robot: Robot, connect: Opener) -> None:
    operator, viewer = await connect(), await connect(robot.token("Vic", Role.VIEWER))
    await viewer.load(await operator.new())
    async with robot.watched() as watched:
        await driving(operator, watched)
        await operator.close()
        await watched.until(lambda: watched.speed == 0 and not watched.state.motion, "the robot at rest")
    await eventually(lambda: "Nobody who may operate me" in viewer.said, "the reason")


async def test_a_visitor_drives_while_an_operator_looks_at_another_session(robot: Robot, connect: Opener) -> None:
    operator, visitor = await connect(), await connect(robot.token("Vera", Role.VISITOR))
    await operator.new()
    await visitor.new()
    async with robot.watched() as watched:
        await driving(visitor, watched)
        begun = watched.states[-1][0]
        await watched.until(lambda: watched.states[-1][0] > begun + 2 * AWAY_S, "twice the time of grace")
        assert watched.state.motion
        await visitor.cancel()
        await watched.until(lambda: watched.speed == 0, "the robot at rest")


async def test_one_who_is_back_in_time_finds_the_robot_driving(robot: Robot) -> None:
    calm = robot.with_another_agent({"ROBOT_ACP_AGENT__UNATTENDED_AFTER": str(BACK_S)})
    address = f"tcp://127.0.0.1:{calm.agent_port}"
    with calm.running("agent", port=calm.agent_port):
        operator = await Client.open(address)
        session = await operator.new()
        async with robot.watched() as watched:
            await driving(operator, watched)
            gone = watched.states[-1][0]
            await operator.close()
            back = await Client.open(address)
            await back.load(session)
            await watched.until(lambda: watched.states[-1][0] > gone + BACK_S + 2.0, "more than the time of grace")
            assert watched.state.motion
            await back.cancel()
            await watched.until(lambda: watched.speed == 0, "the robot at rest")
        await back.close()


async def test_the_autonomous_mode_needs_nobody(robot: Robot, connect: Opener) -> None:
    operator = await connect()
    session = await operator.new()
    await operator.link.request("session/set_mode", {"sessionId": session, "modeId": "autonomous"})
    async with robot.watched() as watched:
        await driving(operator, watched)
        await operator.close()
        gone = watched.states[-1][0]
        await watched.until(lambda: watched.states[-1][0] > gone + 2 * AWAY_S, "twice the time of grace")
        assert watched.state.motion
    back = await connect()
    await back.load(session)
    await back.cancel()
