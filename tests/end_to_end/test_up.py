"""`robot-acp up`: one command starts three processes, keeps them, and ends them."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path

import httpx

from tests.end_to_end.conftest import start
from tests.processes import PATIENCE_S, Robot, end, listens, wait_until

ROOT = Path(__file__).parent.parent.parent


def children(pid: int) -> list[int]:
    tasks = Path(f"/proc/{pid}/task/{pid}/children")
    return [int(child) for child in tasks.read_text().split()]


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def health(robot: Robot) -> dict[str, object]:
    try:
        answer = httpx.get(f"http://127.0.0.1:{robot.bridge_port}/api/health", trust_env=False)
    except httpx.HTTPError:
        return {}
    return dict(answer.json())


def test_ctrl_c_ends_all_three_and_leaves_none(tmp_path: Path) -> None:
    up = start(Robot(tmp_path))
    pids = children(up.process.pid)
    assert len(pids) == 3
    assert end(up.process, signal.SIGINT) == 0
    assert not any(alive(pid) for pid in pids)


def test_a_process_that_dies_is_started_again_and_the_others_stay(tmp_path: Path) -> None:
    up = start(Robot(tmp_path))
    try:
        wait_until(lambda: health(up.robot).get("status") == "ok", "all three to be up")
        before = children(up.process.pid)
        agent = next(pid for pid in before if "agent" in Path(f"/proc/{pid}/cmdline").read_text().split("\0"))
        os.kill(agent, signal.SIGKILL)
        wait_until(lambda: agent not in children(up.process.pid), "the loss of the agent")
        wait_until(lambda: len(children(up.process.pid)) == 3, "another agent")
        wait_until(lambda: health(up.robot).get("status") == "ok", "the agent's return")
        assert set(before) - {agent} < set(children(up.process.pid))
    finally:
        end(up.process, signal.SIGINT)


def test_an_address_that_is_taken_is_told_with_what_to_do(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    with robot.running("robot", port=robot.robot_port):
        process = robot.start("up", stderr=subprocess.PIPE)
        _, error = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    assert f"The robot cannot use 127.0.0.1:{robot.robot_port}" in error
    assert "choose another port with ROBOT_ACP_ROBOT__PORT" in error
    assert not listens(robot.bridge_port)


def test_a_setting_that_cannot_be_used_is_named(tmp_path: Path) -> None:
    file = tmp_path / "robot.toml"
    file.write_text('[robot]\nmax_sped = 1\n[robot.limits]\nmax_speed = "fast"\n')
    process = Robot(tmp_path).start("--config", str(file), "up", stderr=subprocess.PIPE)
    _, error = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    assert "robot.max_sped" in error
    assert "robot.limits.max_speed" in error


def test_a_second_start_installs_and_builds_nothing() -> None:
    prepare = ["sh", "-c", ". scripts/prepare.sh && prepare_python requirements-dev.lock && prepare_web"]
    for _ in range(2):
        done = subprocess.run(prepare, cwd=ROOT, text=True, capture_output=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")
