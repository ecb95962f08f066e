"""A forked command is as good as one in a new Python: environment, streams, signals and exit status are its own."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path

import pytest

from backend.identity import Role
from tests.forked import Forked
from tests.processes import PATIENCE_S, Robot, listens, wait_until


def run(robot: Robot, *arguments: str) -> tuple[int, str, str]:
    streams = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = Forked(arguments, robot.variables, **streams)
    said, complained = process.communicate(PATIENCE_S)
    return process.wait(), said or "", complained or ""


def test_it_has_its_own_environment_and_streams(tmp_path: Path) -> None:
    one, other = Robot(tmp_path / "one"), Robot(tmp_path / "other")
    one.token("Ana", Role.VIEWER)
    status, said, _ = run(one, "token", "list")
    assert status == 0
    assert "Ana" in said
    assert "There are no login tokens yet." in run(other, "token", "list")[1]
    assert "ROBOT_ACP_DATA_DIR" not in os.environ


@pytest.mark.parametrize("arguments", [["no-such-command"], ["--config", "/no/such/file", "doctor"]])
def test_its_exit_status_and_complaint_are_those_of_the_command(tmp_path: Path, arguments: list[str]) -> None:
    robot = Robot(tmp_path)
    forked = run(robot, *arguments)
    real = subprocess.run(robot.command(*arguments), env=robot.variables, capture_output=True, text=True, check=False)
    assert forked[0] == real.returncode == 2
    assert forked[2].splitlines()[-1].split(": ", 1)[1] == real.stderr.splitlines()[-1].split(": ", 1)[1]


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGTERM, 0), (signal.SIGINT, 0), (signal.SIGKILL, -signal.SIGKILL)]
)
def test_signals_end_it_as_they_end_the_command(tmp_path: Path, number: int, status: int) -> None:
    robot = Robot(tmp_path)
    process = robot.spawn("agent")
    wait_until(lambda: listens(robot.agent_port), "the agent")
    process.send_signal(number)
    assert process.wait(PATIENCE_S) == status
