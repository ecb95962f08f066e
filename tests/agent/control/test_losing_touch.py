"""An agent that is killed, or hangs, in the middle of a drive leaves no robot driving."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from backend.config import Limits
from tests.processes import Client, Robot, end


@pytest.mark.parametrize(("number", "code"), [(signal.SIGKILL, None), (signal.SIGSTOP, "silent")])
async def test_the_robot_halts_long_before_it_is_there(
    tmp_path: Path, number: signal.Signals, code: str | None
) -> None:
    robot = Robot(tmp_path, {"ROBOT_ACP_ROBOT__LIMITS__CLIENT_SILENCE": str(Limits().client_silence)})
    with (
        robot.running("robot", port=robot.robot_port),
        robot.running("agent", port=robot.agent_port) as agent,
    ):
        client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
        await client.new()
        async with robot.watched() as watched:
            prompt = client.later(client.prompt("go to lab 2.3.7"))
            await watched.until(lambda: watched.speed > 0.4, "the robot to drive")
            agent.send_signal(number)
            await watched.until(lambda: watched.state.motion is None and watched.speed == 0.0, "the robot to rest")
            assert watched.distance_to(11.8, 4.0) > 3
            assert (watched.state.halted and watched.state.halted.code) == code
        prompt.cancel()
        end(agent, signal.SIGKILL)
        await client.close()
