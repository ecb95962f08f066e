"""An agent that is killed, or hangs, in the middle of a drive leaves no robot driving."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import pytest

from backend.config import Limits
from tests.processes import Client, Robot, end

MARGIN_S = 0.5
"""Braking, telemetry, and a busy machine."""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
async def test_the_robot_halts_within_the_watchdogs_limit(tmp_path: Path, number: signal.Signals) -> None:
    robot = Robot(tmp_path)
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
            lost = time.monotonic()
            await watched.until(lambda: watched.state.motion is None and watched.speed == 0.0, "the robot to rest")
            assert time.monotonic() - lost < Limits().client_silence + MARGIN_S
            assert watched.distance_to(11.8, 4.0) > 3
        prompt.cancel()
        end(agent, signal.SIGKILL)
        await client.close()
