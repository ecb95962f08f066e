"""A turn that was cancelled keeps the robot until it is at rest, and sets the stop where it does not come to rest."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from backend.agent.control.lease import Lease
from backend.agent.control.policy import Policy
from backend.agent.robot.mcp_client import McpClient, Tool, ToolResult
from backend.agent.robot.robot_client import RobotClient
from backend.agent.sessions.session import Session
from backend.agent.turns import model
from backend.agent.turns.environment import TurnEnvironment
from backend.agent.turns.turn import Turn
from backend.audit import Audit
from backend.robot_server import RobotServerClient
from tests.agent.runaway_robot import Runaway
from tests.agent.turns.test_cancelled_turns import ANA, session  # noqa: F401 - a fixture
from tests.processes import Client, Robot, eventually


class Driving(McpClient):
    """A robot with one tool, which drives until it is cancelled."""

    def __init__(self) -> None:
        super().__init__("http://127.0.0.1:1/mcp", absent="")
        self.drives = asyncio.Event()

    async def tools(self) -> dict[str, Tool]:
        return {"drive": Tool("drive", "Drive.", {}, "Drive", None, False)}

    async def call(self, *_: Any, **__: Any) -> ToolResult:
        self.drives.set()
        await asyncio.Event().wait()
        raise AssertionError


async def driving(*_: Any) -> AsyncIterator[model.Part]:
    yield model.Call("drive", {})


@asynccontextmanager
async def cancelled(session: Session, link: RobotClient, lease: Lease) -> AsyncIterator[asyncio.Task[str]]:  # noqa: F811
    """A turn that was cancelled in the middle of a drive."""
    tools, policy = Driving(), Policy({"supervised": {"drive": "allow"}})
    environment = TurnEnvironment(
        "Sancho",
        tools,
        policy,
        link,
        session._journal._store,
        lease,
        1.0,
        5,
        1.0,
        infer=driving,
        audit=Audit(Path("/"), "agent"),
    )
    prompt = [{"type": "text", "text": "drive"}]
    turn = asyncio.create_task(session.run_turn(Turn(environment, session, ANA, prompt, None)))
    await eventually(tools.drives.is_set, "the drive")
    session.cancel()
    try:
        yield turn
    finally:
        for task in session._tasks:
            task.cancel()
        await asyncio.gather(turn, return_exceptions=True)


def told(session: Session) -> str:  # noqa: F811
    return str(session.history.messages())


async def test_a_robot_that_drives_on_after_a_cancel_is_stopped(session: Session) -> None:  # noqa: F811
    robot, lease = Runaway(), Lease()
    async with robot.linked() as link, cancelled(session, link, lease) as turn:
        assert await turn == "cancelled"
        assert robot.stops == ["the agent"]
        assert robot.speed == 0.0, "the prompt was answered while the robot moved"
    assert "I still move, although I had to halt, so I set the stop. A supervisor has to release it." in told(session)
    assert lease.holder is None


async def test_a_robot_that_ignores_its_stop_is_given_to_nobody(session: Session) -> None:  # noqa: F811
    robot, lease = Runaway(obeys_stop=False), Lease()
    async with robot.linked() as link, cancelled(session, link, lease) as turn:
        await eventually(lambda: "although the stop is set. Use the robot's own stop button." in told(session), "this")
        session.cancel()  # ends nothing
        assert lease.holder is not None
        assert not turn.done()
        robot.speed = 0.0
        assert await turn == "cancelled"
    assert lease.holder is None
    assert told(session).count("Use the robot's own stop button.") == 1


async def test_a_robot_without_telemetry_may_drive_and_is_stopped(session: Session) -> None:  # noqa: F811
    robot, lease = Runaway(), Lease()
    async with robot.linked() as link:
        robot.silent = True
        await eventually(lambda: link.state is None, "the silence to be noticed")
        async with cancelled(session, link, lease) as turn:
            await eventually(lambda: "my telemetry is missing, so I set the stop." in told(session), "this")
            assert robot.stops
            assert lease.holder is not None
            assert not turn.done()
            robot.silent = False
            assert await turn == "cancelled"
    assert lease.holder is None


async def test_where_the_stop_cannot_be_set_people_are_told_to_set_it(session: Session) -> None:  # noqa: F811
    robot, lease = Runaway(takes_stop=False), Lease()
    async with robot.linked() as link, cancelled(session, link, lease) as turn:
        await eventually(lambda: "the stop could not be set. Use the robot's own stop button." in told(session), "this")
        assert lease.holder is not None
        assert not turn.done()
        robot.takes_stop = True
        assert await turn == "cancelled"
        assert robot.stops


async def test_a_robot_that_comes_to_rest_by_itself_is_not_stopped(session: Session) -> None:  # noqa: F811
    robot, lease = Runaway(), Lease()
    async with robot.linked(rest_timeout=60.0) as link, cancelled(session, link, lease) as turn:
        robot.speed = 0.0
        assert await turn == "cancelled"
    assert robot.stops == []
    assert "stop" not in told(session)


async def test_people_are_asked_to_check_a_robot_that_reports_nothing(session: Session) -> None:  # noqa: F811
    lease = Lease()
    async with cancelled(session, RobotClient(RobotServerClient(None)), lease) as turn:
        assert await turn == "cancelled"
    assert "This robot does not report its motion. Check that it stands still." in told(session)
    assert lease.holder is None


@pytest.mark.processes
async def test_a_robot_server_that_hangs_in_mid_drive_keeps_its_turn(tmp_path: Path) -> None:
    """The processes themselves: the agent waits for the robot, and ends in order when it is ended meanwhile."""
    robot = Robot(tmp_path)
    with (
        robot.running("robot", port=robot.robot_port) as server,
        robot.running("agent", port=robot.agent_port),
    ):
        client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
        other = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
        await client.new()
        await other.new()
        async with robot.watched() as watched:
            turn = client.later(client.prompt("go to lab 2.3.9"))
            await watched.until(lambda: watched.speed > 0.3, "the robot to drive")
            server.send_signal(signal.SIGSTOP)
            try:
                await client.cancel()
                waiting = other.later(other.prompt("turn left by 20 degrees"))
                await eventually(lambda: "I cannot tell whether I stand still" in client.said, "this to be told")
                assert not turn.done()
                assert not waiting.done()
            finally:
                server.send_signal(signal.SIGCONT)
            assert await turn == "cancelled"
            assert await waiting == "end_turn"
        assert await robot.stands()
        await client.close()
        await other.close()
