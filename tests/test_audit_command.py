"""`robot-acp audit` prints what the commands and processes of the robot recorded."""

from __future__ import annotations

import csv
import io
import json
import subprocess
import time
from pathlib import Path
from typing import Any

import orjson
import pytest

from backend import audit
from backend.audit import Audit
from backend.cli import main
from tests.processes import Client, Robot


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return Robot(tmp_path / "data")


def command(robot: Robot, *arguments: str) -> str:
    done = subprocess.run(
        robot.command(*arguments), env=robot.variables, text=True, capture_output=True, check=True, timeout=60
    )
    return done.stdout


def printed(robot: Robot, *arguments: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in command(robot, "audit", *arguments).splitlines()]


@pytest.mark.processes
def test_the_commands_of_tokens_and_keys_are_in_the_log(robot: Robot) -> None:
    assert printed(robot) == []
    assert not robot.data.exists(), "reading makes nothing"
    token = command(robot, "token", "create", "--name", "Ana", "--role", "operator").strip()
    command(robot, "token", "revoke", "Ana")
    command(robot, "token", "create", "--name", "Ben", "--role", "viewer")
    command(robot, "login")
    command(robot, "key", "rotate", "--old-until", "now")
    created, revoked, _, code, rotated = printed(robot)
    assert [entry["event"] for entry in (created, revoked, code, rotated)] == [
        "token_created",
        "token_revoked",
        "code_created",
        "key_rotated",
    ]
    assert (code["process"], code["created_role"]) == ("command", "supervisor")
    assert created["process"] == "command"
    assert created["uid"] == rotated["uid"]
    assert (created["created_name"], created["created_role"]) == ("Ana", "operator")
    assert (revoked["revoked"], revoked["revoked_name"]) == (created["created"], "Ana")
    assert rotated["tokens"] == 1
    assert token not in (robot.data / audit.FILE).read_text()


@pytest.mark.processes
async def test_a_session_that_is_deleted_by_command_is_in_the_log(robot: Robot) -> None:
    with robot.running("agent", port=robot.agent_port):
        client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
        sessions = []
        for _ in range(2):
            sessions.append(await client.new())
            await client.prompt("/export")
        await client.close()
        command(robot, "sessions", "delete", sessions[0])
    command(robot, "sessions", "delete", sessions[1])
    first, second = [entry for entry in printed(robot) if entry["event"] == "session_deleted"]
    assert (first["process"], first["by"], first["session"]) == ("agent", "local", sessions[0])
    assert (second["process"], second["session"], second["owner"]) == ("command", sessions[1], "local")


def test_the_oldest_event_comes_first_and_times_are_readable(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    now = time.time()
    lines = [{"time": at, "process": "agent", "event": "stop"} for at in (now - 9 * 86400, now, now - 2)]
    (tmp_path / audit.FILE).write_bytes(b"".join(orjson.dumps(line) + b"\n" for line in lines))
    assert main(["--data-dir", str(tmp_path), "audit"]) == 0
    times = [json.loads(line)["time"] for line in capsys.readouterr().out.splitlines()]
    assert times == sorted(times)
    assert all(at.endswith("+00:00") for at in times)
    for since, count in (("7d", 2), ("1m", 2), ("30d", 3), ("2020-01-31", 3), ("9999-01-01", 0)):
        assert main(["--data-dir", str(tmp_path), "audit", "--since", since]) == 0
        assert len(capsys.readouterr().out.splitlines()) == count
    with pytest.raises(SystemExit):
        main(["--data-dir", str(tmp_path), "audit", "--since", "yesterday"])
    assert "neither a time such as" in capsys.readouterr().err


def test_csv_has_one_row_an_event_and_no_formula(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = Audit(tmp_path, "bridge")
    log.record("stop", '=HYPERLINK("http://evil.example")', confirmed=True)
    log.record("login_refused", None, reason='a,"b"\nc')
    log.close()
    assert main(["--data-dir", str(tmp_path), "audit", "--csv"]) == 0
    stop, refused = csv.DictReader(io.StringIO(capsys.readouterr().out))
    assert stop["by"] == '\'=HYPERLINK("http://evil.example")'
    assert json.loads(stop["details"]) == {"confirmed": True}
    assert (refused["by"], json.loads(refused["details"])["reason"]) == ("", 'a,"b"↵c')


@pytest.mark.processes
def test_a_reader_that_has_seen_enough_gets_no_error(robot: Robot) -> None:
    robot.data.mkdir(mode=0o700)
    line = orjson.dumps({"time": 1.0, "process": "agent", "event": "stop", "by": "x" * 200}) + b"\n"
    (robot.data / audit.FILE).write_bytes(line * 20_000)
    shell = f"{' '.join(robot.command('audit'))} | head -n 1; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", shell], env=robot.variables, text=True, capture_output=True, timeout=60)
    assert done.stdout.splitlines()[-1] == "0"
    assert done.stderr == ""
