"""Whoever moves the robot must be heard: a client that is gone, stopped, or behind a dead line leaves none driving."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
import sys
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from backend import meta as keys
from backend.agent.robot.mcp_client import McpClient
from backend.config import Limits
from backend.mcp_robot.tools import watchdog
from backend.sockets import notice_loss
from tests.mcp_robot.conftest import Reader, Served, serving
from tests.mcp_robot.tools.stalling_proxy import proxy_to
from tests.mcp_robot.tools.test_tools import call

SILENCE = 2.0
"""The watchdog's limit in these tests, in seconds."""
WITHIN = SILENCE + 4.0
"""Seconds of the robot's own time, which stands while the machine does: a drive to the lab takes more than 20."""
LIMITS = {"client_silence": SILENCE}

LEGACY = """
import asyncio, sys
from mcp import Client
from mcp.client.streamable_http import streamable_http_client
from mcp.shared._httpx_utils import create_mcp_http_client

async def main(url, token, place):
    async with create_mcp_http_client(headers={"Authorization": "Bearer " + token}) as http:
        async with Client(streamable_http_client(url, http_client=http), mode="legacy") as client:
            await client.call_tool("navigate_to_place", {"place": place})

asyncio.run(main(*sys.argv[1:]))
"""
AGENT = """
import asyncio, sys
from backend.agent.robot.mcp_client import McpClient

async def main(url, token, place):
    tools = McpClient(url, {"Authorization": "Bearer " + token}, absent="gone")
    await tools.call("navigate_to_place", {"place": place})

asyncio.run(main(*sys.argv[1:]))
"""
"""The agent's own connection, which speaks protocol 2026-07-28 and gives the sign of life that it needs."""
CLIENTS = pytest.mark.parametrize("code", [LEGACY, AGENT], ids=["legacy", "agent"])


@contextlib.asynccontextmanager
async def client(robot: Served, code: str, port: int | None = None) -> AsyncIterator[asyncio.subprocess.Process]:
    """A client process that drives to a lab."""
    url = f"http://127.0.0.1:{port or robot.port}/mcp"
    process = await asyncio.create_subprocess_exec(sys.executable, "-c", code, url, robot.token, "lab 2.3.7")
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()


async def seconds_to_rest(reader: Reader) -> float:
    """Wait until the robot stands; returns how long that took on its own clock."""
    began = (await reader.state()).time
    return (await reader.state(lambda s: s.motion is None and s.twist.linear == 0)).time - began


@pytest.mark.processes
@CLIENTS
async def test_a_client_that_is_killed_in_mid_motion(tmp_path: Path, code: str) -> None:
    async with (
        serving(tmp_path, time_scale=1.0, limits=LIMITS) as robot,
        robot.telemetry("state", rate=50) as reader,
        client(robot, code) as process,
    ):
        await reader.state(lambda s: s.twist.linear > 0.3)
        process.kill()
        assert await seconds_to_rest(reader) < WITHIN


@pytest.mark.processes
@CLIENTS
async def test_a_client_process_that_is_stopped_while_its_kernel_goes_on(tmp_path: Path, code: str) -> None:
    async with (
        serving(tmp_path, time_scale=1.0, limits=LIMITS) as robot,
        robot.telemetry("state", rate=50) as reader,
        client(robot, code) as process,
    ):
        await reader.state(lambda s: s.twist.linear > 0.3)
        process.send_signal(signal.SIGSTOP)
        assert await seconds_to_rest(reader) < WITHIN


@pytest.mark.processes
@CLIENTS
async def test_a_line_that_goes_dead_without_closing(tmp_path: Path, code: str) -> None:
    async with (
        serving(tmp_path, time_scale=1.0, limits=LIMITS) as robot,
        robot.telemetry("state", rate=50) as reader,
        proxy_to(robot.port) as proxy,
        client(robot, code, proxy.port),
    ):
        await reader.state(lambda s: s.twist.linear > 0.3)
        proxy.stall()
        assert await seconds_to_rest(reader) < WITHIN


@pytest.mark.processes
@CLIENTS
async def test_a_client_that_is_heard_drives_as_long_as_it_takes(tmp_path: Path, code: str) -> None:
    limits = {"client_silence": 2 * SILENCE, "unheard_motion": 2 * SILENCE}
    async with (
        serving(tmp_path, time_scale=2.0, limits=limits) as robot,
        robot.telemetry("state") as reader,
        client(robot, code) as process,
    ):
        began = (await reader.state(lambda s: s.motion is not None)).time
        await reader.state(lambda s: s.pose.x > 6.0)
        ended = await reader.state(lambda s: s.motion is None)
        assert (ended.time - began) / 2.0 > 2 * 2 * SILENCE
        assert ended.pose.x == pytest.approx(11.8, abs=0.1)
        assert await process.wait() == 0


async def test_the_agents_connection_outlives_the_silence_that_ended_its_motion(tmp_path: Path) -> None:
    async with (
        serving(tmp_path, time_scale=1.0, limits=LIMITS) as robot,
        robot.telemetry("state", rate=50) as reader,
        proxy_to(robot.port) as proxy,
    ):
        tools = McpClient(f"http://127.0.0.1:{proxy.port}/mcp", robot.headers, absent="gone")
        driving = asyncio.create_task(tools.call("navigate_to_place", {"place": "lab 2.3.7"}))
        await reader.state(lambda s: s.twist.linear > 0.3)
        proxy.stall()
        await seconds_to_rest(reader)
        proxy.resume()
        result = await driving
        assert result.failed
        assert result.text.startswith("silent: The client has been silent for 2 s")
        assert not (await tools.call("rotate_in_place", {"degrees": 5})).failed
        await tools.close()


async def test_a_client_without_a_sign_of_life_moves_the_robot_for_a_limited_time(tmp_path: Path) -> None:
    async with (
        serving(tmp_path, time_scale=1.0, limits={"unheard_motion": SILENCE}) as robot,
        robot.mcp() as mcp,
        robot.telemetry("state", rate=50) as reader,
    ):
        result = await mcp.call_tool("navigate_to_place", {"place": "lab 2.3.7"})
        assert result.is_error
        assert (result.structured_content or {})["error"]["code"] == "no_sign_of_life"
        stands = await reader.state(lambda s: s.motion is None and s.twist.linear == 0 and s.halted is not None)
        assert stands.pose.x < 11.8 - 1.0  # it was not there yet


async def test_no_motion_at_all_for_clients_without_a_sign_of_life_where_that_is_set(tmp_path: Path) -> None:
    async with serving(tmp_path, limits={"unheard_motion": 0}) as robot, robot.mcp() as mcp:
        before = await call(mcp, "get_current_pose")
        result = await mcp.call_tool("rotate_in_place", {"degrees": 90})
        assert (result.structured_content or {})["error"]["code"] == "no_sign_of_life"
        assert (await call(mcp, "get_current_pose"))["yaw"] == before["yaw"]


async def test_the_same_name_in_two_calls_is_heard_for_both() -> None:
    callers = watchdog.Callers()
    first = asyncio.create_task(callers.listen("Ana", 0.2))
    second = asyncio.create_task(callers.listen("Ana", 0.4))
    began = asyncio.get_running_loop().time()
    while asyncio.get_running_loop().time() - began < 0.6:
        callers.hear("Ana")
        callers.hear("Ben")
        await asyncio.sleep(0)
    assert not first.done()
    assert not second.done()
    await first
    callers.hear("Ana")
    await second


async def test_while_this_process_stood_a_named_client_was_not_silent() -> None:
    callers = watchdog.Callers()
    listening = asyncio.create_task(callers.listen("Ana", 0.5))
    await stand(1.0)
    assert not listening.done()
    await listening


async def test_while_this_process_stood_a_client_that_is_asked_was_not_silent() -> None:
    answered = asyncio.Event()

    async def ask() -> None:
        await answered.wait()

    asking = asyncio.create_task(watchdog._until_unanswered(ask, 0.5))
    await stand(1.0)
    answered.set()
    await stand(0.0)
    assert not asking.done()
    answered.clear()
    await asking


async def stand(seconds: float) -> None:
    """As if the computer had been too busy for this process; then everything that waits gets its turn."""
    await asyncio.sleep(0)
    asyncio.get_running_loop().call_soon(time.sleep, seconds)
    for _ in range(10):
        await asyncio.sleep(0)


@pytest.mark.parametrize("name", [None, 7, "", "x" * 201, ["Ana"]])
def test_a_name_that_is_none_is_no_name(name: Any) -> None:
    assert watchdog.caller({keys.CALLER: name}) is None
    assert watchdog.caller(None) is None


def test_the_kernel_breaks_a_connection_whose_other_end_is_gone() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        notice_loss(listener, Limits().client_silence)
        with socket.create_connection(listener.getsockname()), listener.accept()[0] as accepted:
            assert accepted.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
            assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 2000
            assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE) == 1
