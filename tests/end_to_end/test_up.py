"""`robot-acp up`: one command starts three processes, keeps them, and ends them."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import httpx

from backend.identity import Role
from tests.end_to_end.conftest import start
from tests.processes import PATIENCE_S, STARTS_S, Robot, end, free_port, listens, wait_until

FOREIGN_ROBOT = Path(__file__).parent.parent / "foreign_robot.py"
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


def test_the_printed_address_logs_in_once_and_the_login_command_prints_another(tmp_path: Path) -> None:
    up = start(Robot(tmp_path))
    try:
        sentence = "It works once; `robot-acp login` prints another."
        wait_until(lambda: sentence in "".join(up.printed), "the sentence about the address")
        assert logged_in(up.base, up.printed_url) == (200, "supervisor")
        assert logged_in(up.base, up.printed_url)[0] == 401
        another = subprocess.run(
            up.robot.command("login"), env=up.robot.variables, text=True, capture_output=True, timeout=PATIENCE_S
        )
        assert logged_in(up.base, another.stdout.strip()) == (200, "supervisor")
    finally:
        end(up.process, signal.SIGINT)


def logged_in(base: str, url: str) -> tuple[int, str]:
    """The status with which the code of an address is answered, and the name of the person who it logs in."""
    code = {"token": url.partition("#token=")[2]}
    answer = httpx.post(f"{base}/api/login", json=code, trust_env=False, timeout=PATIENCE_S)
    return answer.status_code, answer.json().get("name", "")


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


def test_with_another_robot_no_robot_of_ours_is_started(tmp_path: Path) -> None:
    port = free_port()
    other = subprocess.Popen([sys.executable, str(FOREIGN_ROBOT), str(port), str(tmp_path / "noted"), "no-stop"])
    try:
        wait_until(lambda: listens(port), "the other robot")
        robot = Robot(tmp_path / "data", {"ROBOT_ACP_AGENT__ROBOT_URL": f"http://127.0.0.1:{port}/mcp"})
        process = robot.start("up", stdout=subprocess.DEVNULL)
        try:
            wait_until(lambda: health(robot).get("status") == "ok", "agent, bridge and the other robot", STARTS_S)
            assert len(children(process.pid)) == 2
            assert not listens(robot.robot_port)
            bearer = {"Authorization": f"Bearer {robot.token('Vera', Role.VIEWER)}"}
            stop = f"http://127.0.0.1:{robot.bridge_port}/api/stop"
            answer = httpx.post(stop, headers=bearer, trust_env=False, timeout=PATIENCE_S)
            assert answer.status_code == 503
            assert answer.json()["error"].startswith("This robot has no stop path here, so it was not stopped.")
        finally:
            end(process, signal.SIGINT)
    finally:
        end(other)


def test_a_world_that_cannot_be_loaded_ends_it_at_once_with_one_sentence(tmp_path: Path) -> None:
    error = output_of_a_failing_up(Robot(tmp_path), "--world", str(tmp_path / "nowhere"))
    assert "Traceback" not in error
    assert error.count("nowhere") == 1
    assert error.splitlines()[-1] == (
        "robot-acp: The robot cannot come up; its own message says why. Everything has ended."
    )
    assert "starting it again" not in error


def test_a_mode_that_there_is_not_ends_it_at_once(tmp_path: Path) -> None:
    error = output_of_a_failing_up(Robot(tmp_path, {"ROBOT_ACP_AGENT__DEFAULT_MODE": "careless"}))
    assert error.count("robot-acp: agent.default_mode: there is no mode 'careless'.") == 1
    assert error.splitlines()[-1] == (
        "robot-acp: The agent cannot come up; its own message says why. Everything has ended."
    )


def output_of_a_failing_up(robot: Robot, *arguments: str) -> str:
    """What `up` writes to stderr; it ends by itself with the status for settings that cannot be used, and leaves
    nothing running."""
    process = robot.start("up", *arguments, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL)
    pids: set[int] = set()
    reading = threading.Thread(target=lambda: pids.update(seen_children(process)))
    reading.start()
    _, error = process.communicate(timeout=STARTS_S)
    reading.join()
    assert process.returncode == 2, error
    assert pids
    assert not any(alive(pid) for pid in pids)
    return str(error)


def seen_children(process: subprocess.Popen[str]) -> set[int]:
    """The ids of all processes that it starts until it ends."""
    seen: set[int] = set()
    while process.poll() is None:
        with contextlib.suppress(OSError):
            seen.update(children(process.pid))
        time.sleep(0.02)
    return seen


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
