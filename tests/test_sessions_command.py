"""`robot-acp sessions delete` and `compact`, beside a running agent and without one."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.processes import Client, Robot


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    return Robot(tmp_path)


def sessions(robot: Robot, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        robot.command("sessions", *arguments), env=robot.variables, text=True, capture_output=True, check=False
    )


async def begun(robot: Robot) -> str:
    client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
    session = await client.new()
    await client.prompt("/export")
    await client.close()
    return session


async def test_sessions_are_deleted_by_the_agent_or_without_it(robot: Robot) -> None:
    with robot.running("agent", port=robot.agent_port):
        first, second = await begun(robot), await begun(robot)
        done = sessions(robot, "delete", first, "nonsense")
        assert done.returncode == 1
        assert "There is no session nonsense" in done.stderr
        assert "Deleted 1 of 2 sessions" in done.stdout
        assert sessions(robot, "compact").returncode == 2
    listed = sessions(robot, "list").stdout
    assert first not in listed
    assert second in listed
    assert "Deleted 0 of 0" in sessions(robot, "delete", "--older-than", "1d").stdout
    done = sessions(robot, "delete", second)
    assert (done.returncode, done.stdout) == (0, "Deleted 1 of 1 sessions.\n")
    assert sessions(robot, "list").stdout == ""
    assert sessions(robot, "compact").returncode == 0
    nothing = sessions(robot, "delete")
    assert nothing.returncode == 2
    assert "Name the sessions to delete" in nothing.stderr
