"""A robot server that hangs keeps its line open and says nothing: what it told last is not told to anybody any more."""

from __future__ import annotations

import signal
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from backend.agent.acp.connection import ClientConnection
from backend.agent.acp.telemetry import TelemetryFeed
from backend.agent.control.lease import Lease
from backend.agent.robot.robot_client import RobotClient
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.store import Store
from backend.agent.wiring import Wiring
from backend.config import Settings
from backend.robot_server import RobotServerClient
from backend.telemetry import Battery, Pose, State, Twist
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


async def test_who_asks_for_little_telemetry_can_still_tell_a_silence_from_it() -> None:
    link, sent = RobotClient(RobotServerClient(None)), list[bytes]()
    journal = Journal(Store("sqlite://"))
    wiring = SimpleNamespace(link=link, turns=SimpleNamespace(lease=Lease()), settings=Settings(), journal=journal)
    connection = SimpleNamespace(identity="Ana", may_approve=False, deliver_latest=lambda _, line: sent.append(line))
    feed = TelemetryFeed(cast(Wiring, wiring), cast(ClientConnection, connection), 0.01)
    state = State(0.0, "Sancho", Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0), Battery(1.0, False), None, None, None)
    await link._set(state)
    before = len(sent)
    await link._set(state)
    assert len(sent) == before
    feed._sent_at -= 2.0  # as after 2 s
    await link._set(state)
    assert len(sent) == before + 1
