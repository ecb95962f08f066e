"""Who is let in without a token: the agent's own user, at the same machine. Other users of it are strangers."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import socket
import stat
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import pytest

from backend import config, local_user
from backend.agent import server
from backend.chat import app as chat
from backend.chat.link import RefusedError
from backend.identity import Role
from tests.processes import PATIENCE_S, Client, Robot, eventually, free_port, listens

OTHER_USER = 65534
CLIENT = """
import encodings.idna, json, os, socket, sys
port, uid, first, second = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], sys.argv[4]
if uid: os.setgid(uid); os.setuid(uid)
plug = socket.create_connection(("127.0.0.1", port), timeout=30)
plug.sendall((first + chr(10) + second + chr(10)).encode())
lines = plug.makefile()
print(lines.readline(), lines.readline(), sep="", end="")
"""
HELLO: dict[str, Any] = {"protocolVersion": 1, "clientCapabilities": {}}
as_another_user = pytest.mark.skipif(os.geteuid() != 0, reason="only root can start a program as another user")
where_users_are_listed = pytest.mark.skipif(not local_user.lists_users(), reason="this system lists no users")


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    robot = Robot(tmp_path_factory.mktemp("data"))
    with robot.running("agent", port=robot.agent_port):
        yield robot


def answers(port: int, uid: int, meta: dict[str, Any] | None = None) -> list[dict[str, Any]]:
    """What a plain TCP client of this user is answered: to `initialize`, and to a request sent at once behind it."""
    hello = {"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": HELLO | ({"_meta": meta} if meta else {})}
    listing = {"jsonrpc": "2.0", "id": 2, "method": "session/list", "params": {}}
    command = [sys.executable, "-c", CLIENT, str(port), str(uid), json.dumps(hello), json.dumps(listing)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def role_of(answer: dict[str, Any]) -> str | None:
    role: str | None = answer["result"]["agentCapabilities"]["_meta"]["robot-acp"].get("role")
    return role


@where_users_are_listed
def test_a_plain_tcp_client_of_the_same_user_needs_nothing(robot: Robot) -> None:
    hello, listing = answers(robot.agent_port, 0 if os.geteuid() == 0 else os.geteuid())
    assert role_of(hello) == "supervisor"
    assert listing["result"]["sessions"] == []


@as_another_user
def test_another_user_of_this_machine_is_a_stranger_until_he_brings_a_token(robot: Robot) -> None:
    hello, refused = answers(robot.agent_port, OTHER_USER)
    assert role_of(hello) is None
    assert refused["error"]["code"] == -32000
    hello, listing = answers(robot.agent_port, OTHER_USER, {"robot-acp/token": robot.token("Ana", Role.VIEWER)})
    assert role_of(hello) == "viewer"
    assert "result" in listing


@pytest.mark.parametrize(("setting", "mine", "theirs"), [("any_user", True, True), ("false", False, False)])
@as_another_user
def test_the_setting_says_who_else_is_let_in(tmp_path: Path, setting: str, mine: bool, theirs: bool) -> None:
    robot = Robot(tmp_path, {"ROBOT_ACP_AGENT__TRUST_LOOPBACK": setting})
    with robot.running("agent", port=robot.agent_port):
        for uid, let_in in ((0, mine), (OTHER_USER, theirs)):
            assert (role_of(answers(robot.agent_port, uid)[0]) == "supervisor") is let_in


@as_another_user
def test_the_port_of_listen_serves_nobody_else(robot: Robot) -> None:
    port = free_port()
    where = f"tcp://127.0.0.1:{robot.agent_port}"
    token = robot.token("Sue", Role.OPERATOR)
    with robot.running("listen", where, "--port", str(port), "--token", token, port=port):
        assert role_of(answers(port, 0)[0]) == "operator"
        (refused,) = answers(port, OTHER_USER)
        assert "serves only the user who opened it" in refused["error"]["message"]


def pair(family: socket.AddressFamily = socket.AF_INET, host: str = "127.0.0.1") -> tuple[socket.socket, socket.socket]:
    with socket.create_server((host, 0), family=family) as listener:
        client = socket.create_connection(listener.getsockname()[:2])
        return listener.accept()[0], client


def is_same_user(accepted: socket.socket) -> bool:
    return local_user.is_same_user(accepted.getsockname()[:2], accepted.getpeername()[:2])


@where_users_are_listed
def test_a_client_counts_while_a_process_holds_its_socket() -> None:
    """Once it is closed, the system says that it is root's: what it had sent before must not be root's word."""
    accepted, client = pair()
    assert is_same_user(accepted)
    client.shutdown(socket.SHUT_WR)
    assert is_same_user(accepted)
    client.close()
    assert not is_same_user(accepted)
    accepted.close()


@where_users_are_listed
def test_ipv6_counts_as_well() -> None:
    with contextlib.closing(socket.socket(socket.AF_INET6)) as probe:
        try:
            probe.bind(("::1", 0))
        except OSError:
            pytest.skip("this machine has no ::1")
    accepted, client = pair(socket.AF_INET6, "::1")
    assert is_same_user(accepted)
    client.close()
    accepted.close()


@where_users_are_listed
def test_the_notation_of_the_tables_is_understood(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = tmp_path / "tcp"
    mapped, v4 = "0000000000000000FFFF00000100007F", "0100007F"
    here, there = ("127.0.0.1", 0x1F90), ("127.0.0.1", 0xC000)
    monkeypatch.setattr(local_user, "TABLES", (table,))
    uid = os.getuid()
    row = "  0: {} {} 01 00000000:00000000 00:00000000 00000000 {:5d}        0 {} 1 0 20 4 30 10 -1\n"
    for line, same in (
        (row.format(f"{v4}:C000", f"{v4}:1F90", uid, 77), sys.byteorder == "little"),
        (row.format(f"{mapped}:C000", f"{mapped}:1F90", uid, 77), sys.byteorder == "little"),
        (row.format(f"{v4}:1F90", f"{v4}:C000", uid, 77), False),  # this end
        (row.format(f"{v4}:C001", f"{v4}:1F90", uid, 77), False),
        (row.format(f"{v4}:C000", f"{v4}:1F90", uid + 1, 77), False),
        (row.format(f"{v4}:C000", f"{v4}:1F90", uid, 0), False),  # held by no process
        ("", False),
    ):
        table.write_text("  sl  local_address rem_address   st\n" + line)
        assert local_user.is_same_user(here, there) is same, line


def test_only_the_loopback_counts_as_this_machine() -> None:
    for host, loopback in (("127.0.0.1", True), ("127.8.9.1", True), ("::1", True), ("::ffff:127.0.0.1", True),
                           ("192.168.1.2", False), ("fe80::1%eth0", False), ("::ffff:10.0.0.1", False)):  # fmt: skip
        assert local_user.is_loopback(host) is loopback


# A system that lists no users: the commands bring a token that the agent wrote.


@pytest.fixture
async def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[config.Settings]:
    """An agent on a system without the tables."""
    monkeypatch.setattr(local_user, "TABLES", (tmp_path / "none",))
    settings = config.load(data_dir=tmp_path / "data", agent={"port": free_port()}, robot={"port": free_port()})
    serving = asyncio.create_task(server.serve(settings))
    await eventually(lambda: listens(settings.agent.port) or serving.done(), "the agent")
    yield settings
    serving.cancel()
    await asyncio.gather(serving, return_exceptions=True)


async def test_without_the_list_a_plain_client_needs_a_token_and_commands_bring_it(elsewhere: config.Settings) -> None:
    stranger = await Client.open(elsewhere.agent_url)
    with pytest.raises(RefusedError, match="Log in first"):
        await stranger.link.request("session/list", {})
    token = local_user.token_for(elsewhere.agent_url, elsewhere)
    await stranger.link.request("authenticate", {"methodId": "token", "_meta": {"robot-acp/token": token}})
    assert (await stranger.link.request("session/list", {}))["sessions"] == []
    await stranger.close()
    file = elsewhere.data_dir / f"local.{elsewhere.agent.port}.token"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert local_user.token_for("tcp://127.0.0.1:1", elsewhere) is None  # never for another address


async def test_without_the_list_chat_works_with_nothing_typed(
    elsewhere: config.Settings, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROBOT_ACP_TOKEN", raising=False)
    reading, writing = os.pipe()
    os.close(writing)
    with os.fdopen(reading) as nothing:
        monkeypatch.setattr(sys, "stdin", nothing)
        assert await chat.run(elsewhere, None, None, None) == 0
    assert "is listening" in capsys.readouterr().out


def test_a_token_that_was_learned_before_a_start_is_of_no_use_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local_user, "TABLES", (tmp_path / "none",))
    first, second = (local_user.write_token(tmp_path / "data", 9100) for _ in range(2))
    assert first != second
    assert (tmp_path / "data" / "local.9100.token").read_text() == second
