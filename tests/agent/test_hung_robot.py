"""A robot server that hangs keeps its line open and says nothing: what it told last is not told to anybody any more."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

from tests.processes import Client, Robot, eventually

TELL_ME = {"_meta": {"robot-acp/telemetry": {"rate": 10}}}


def told(client: Client) -> list[dict[str, Any]]:
    return [message["params"] for message in client.heard if message["method"] == "_robot/telemetry"]


async def test_a_robot_server_that_hangs_is_one_that_cannot_be_reached(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    with (
        robot.running("robot", port=robot.robot_port) as server,
        robot.running("agent", port=robot.agent_port),
    ):
        address = f"tcp://127.0.0.1:{robot.agent_port}"
        present = await Client.open(address, capabilities=TELL_ME)
        await eventually(lambda: told(present) and told(present)[-1]["online"], "the robot")
        server.send_signal(signal.SIGSTOP)
        try:
            await eventually(lambda: not told(present)[-1]["online"], "the silence to be told")
            late = await Client.open(address, capabilities=TELL_ME)
            await eventually(lambda: told(late), "what is told to whoever comes later")
            assert not told(late)[0]["online"]
        finally:
            server.send_signal(signal.SIGCONT)
        await eventually(lambda: told(present)[-1]["online"] and told(late)[-1]["online"], "the robot again")
        await present.close()
        await late.close()
