"""Whoever lets a process listen on the network without TLS is told what others can read, and what to do."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from backend import exposure
from backend.config import load
from tests.processes import Robot

NOT_OURS = "192.0.2.1"
"""An address for documentation (RFC 5737), which no machine has: a process that is to listen there ends."""


@pytest.mark.processes
@pytest.mark.parametrize(
    ("process", "readable", "advice"),
    [
        ("robot", "the secret that moves the robot", "set robot.host to 127.0.0.1"),
        ("agent", "login tokens, conversations", "let clients come through the bridge"),
        ("bridge", "login tokens, conversations, the camera", "put a reverse proxy with TLS in front of it"),
    ],
)
def test_a_process_warns_as_it_begins(tmp_path: Path, process: str, readable: str, advice: str) -> None:
    robot = Robot(tmp_path / "data", {f"ROBOT_ACP_{process.upper()}__HOST": NOT_OURS})
    done = subprocess.run(
        robot.command(process), env=robot.variables, text=True, capture_output=True, check=False, timeout=90
    )
    assert done.returncode == 2, "it cannot listen there"
    (warning,) = [line for line in done.stderr.splitlines() if "without TLS" in line]
    assert "WARNING" in warning
    assert f"{NOT_OURS}:" in warning
    assert readable in warning
    assert advice in warning


@pytest.mark.parametrize("process", ["robot", "agent", "bridge"])
@pytest.mark.parametrize("host", ["127.0.0.1", "127.8.9.1", "::1", "localhost", "LOCALHOST"])
def test_an_address_of_the_loopback_needs_no_warning(process: exposure.Process, host: str) -> None:
    assert exposure.warning(load(**{process: {"host": host}}), process) is None


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "", "192.168.1.4", "fe80::1%eth0", "robot.local"])  # noqa: S104
def test_every_other_address_has_one(host: str) -> None:
    assert exposure.warning(load(bridge={"host": host}), "bridge") is not None


@pytest.mark.processes
def test_the_doctor_warns_and_nothing_is_missing(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "data", {"ROBOT_ACP_BRIDGE__HOST": NOT_OURS})
    done = subprocess.run(
        robot.command("doctor"), env=robot.variables | {"HOME": os.environ["HOME"]}, text=True, capture_output=True,
        check=False, timeout=90,
    )  # fmt: skip
    assert "warning  bridge: it listens on 192.0.2.1:" in done.stdout
    assert "→ Set bridge.host to 127.0.0.1" in done.stdout
    assert "none missing, 1 warning." in done.stdout
    assert done.returncode == 0
