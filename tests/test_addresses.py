"""Addresses of every kind: `up` and all that reaches it work on IPv6, and nothing of the current folder is started."""

from __future__ import annotations

import asyncio
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest

from backend import addresses, config
from backend.identity import Role
from tests.processes import PATIENCE_S, STARTS_S, Client, Robot, end, wait_until

HERE = {f"ROBOT_ACP_{name}__HOST": "::1" for name in ("ROBOT", "AGENT", "BRIDGE")}


def has_ipv6() -> bool:
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        return False
    return True


on_ipv6 = pytest.mark.skipif(not has_ipv6(), reason="this machine has no ::1")


@pytest.mark.parametrize(
    ("host", "written"),
    [
        ("127.0.0.1", "127.0.0.1:80"),
        ("localhost", "localhost:80"),
        ("::1", "[::1]:80"),
        ("fd00::2", "[fd00::2]:80"),
        ("fe80::1%eth0", "[fe80::1%eth0]:80"),
    ],
)
def test_a_url_is_read_back_as_the_host_and_port_it_was_made_of(host: str, written: str) -> None:
    url = addresses.url("tcp", host, 80, "/path")
    assert url == f"tcp://{written}/path"
    parts = urlsplit(url)
    assert (parts.hostname, parts.port) == (host, 80)


@pytest.mark.parametrize(
    ("host", "there"),
    [("0.0.0.0", "127.0.0.1"), ("::", "[::1]"), ("::1", "[::1]")],  # noqa: S104 - nothing is bound
)
def test_the_settings_name_an_address_that_can_be_reached(host: str, there: str) -> None:
    settings = config.load(robot={"host": host}, agent={"host": host}, bridge={"host": host})
    assert settings.robot_base_url == f"http://{there}:8000"
    assert settings.robot_mcp_url == f"http://{there}:8000/mcp"
    assert settings.agent_address == f"tcp://{there}:9100"
    assert settings.bridge_url == f"http://{there}:8080"


def test_no_other_file_puts_a_url_together() -> None:
    backend = Path(addresses.__file__).parent
    allowed = {backend / "addresses.py", backend / "agent" / "robot" / "server_addresses.py"}  # checked parts of a URL
    for file in backend.rglob("*.py"):
        text = file.read_text()
        for mistake in (".host}:{", "{host}:{", "://%s:%"):
            assert mistake not in text or file in allowed, f"{file} puts {mistake} together: use addresses.url"


@contextmanager
def up(robot: Robot, command: list[str], folder: Path) -> Iterator[str]:
    """`up` in this folder; yields the address that it prints."""
    process = subprocess.Popen(
        [*command, "up"], env=robot.variables, cwd=folder, text=True, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL
    )
    try:
        assert process.stdout is not None
        yield next(line.strip() for line in process.stdout if "#token=" in line)
    finally:
        end(process)


@on_ipv6
@pytest.mark.processes
def test_everything_runs_and_is_reached_on_ipv6(tmp_path: Path) -> None:
    robot = Robot(tmp_path / "data", HERE)
    with up(robot, [sys.executable, "-m", "backend.cli"], Path.cwd()) as address:
        url, code = address.split("/#token=")
        token = robot.token("Ana", Role.SUPERVISOR)
        assert url == f"http://[::1]:{robot.bridge_port}"
        bearer = {"Authorization": f"Bearer {token}"}
        with httpx.Client(base_url=url, headers=bearer, trust_env=False, timeout=PATIENCE_S) as web:
            health = web.get("/api/health").json()
            assert (health["agent"]["up"], health["robot"]["up"]) == (True, True)
            assert web.post("/api/stop").status_code == 200
            assert web.post("/api/release").status_code == 200
            wait_until(lambda: web.get("/scene/").status_code == 200, "the scene", STARTS_S)
            assert web.post("/api/login", json={"token": code}, headers={"Origin": url}).status_code == 200
        asyncio.run(prompts(f"ws://[::1]:{robot.bridge_port}/acp", token))
        asyncio.run(prompts(f"tcp://[::1]:{robot.agent_port}", None))
        said = {}
        for command, login in (("chat", ""), ("connect", token), ("doctor", "")):
            environment = robot.variables | {"ROBOT_ACP_TOKEN": login}
            done = subprocess.run(
                robot.command(command), env=environment, input="", capture_output=True, text=True, timeout=STARTS_S
            )
            assert done.returncode == 0, done.stderr
            said[command] = done.stdout
        assert "is listening" in said["chat"]
        for name, port in (("robot", robot.robot_port), ("agent", robot.agent_port), ("bridge", robot.bridge_port)):
            assert f"{name}: it answers on [::1]:{port}" in said["doctor"]
        second = subprocess.run(
            robot.command("up"), env=robot.variables, capture_output=True, text=True, timeout=STARTS_S, check=False
        )
        assert second.returncode == 2
        assert f"The robot cannot use [::1]:{robot.robot_port}" in second.stderr


async def prompts(address: str, token: str | None) -> None:
    client = await Client.open(address, token)
    await client.new()
    assert await client.prompt("where are you?") == "end_turn"
    assert "I am at x" in client.said
    await client.close()


TRAP = (
    "import pathlib, sys\npathlib.Path({marker!r}).write_text(str(sys.argv))\nsys.exit('not the installed program')\n"
)


@pytest.mark.processes
def test_up_starts_nothing_of_the_folder_that_it_is_started_in(tmp_path: Path) -> None:
    folder, marker = tmp_path / "download", tmp_path / "executed"
    (folder / "backend").mkdir(parents=True)
    for name in ("backend/__init__.py", "backend/cli.py", "uvicorn.py", "httpx.py", "random.py"):
        (folder / name).write_text(TRAP.format(marker=str(marker)))
    installed = str(Path(sys.executable).with_name("robot-acp"))
    with up(Robot(tmp_path / "data"), [installed], folder) as address:
        assert address.startswith("http://127.0.0.1:")
        assert httpx.get(address.split("#")[0] + "api/health", trust_env=False).json()["robot"]["up"]
    assert not marker.exists()
