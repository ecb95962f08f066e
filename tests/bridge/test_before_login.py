"""What the bridge gives to connections that have not logged in: little time, and room only while nobody else needs it.

And what that is for: Stop works however many of them there are.
"""

from __future__ import annotations

import asyncio
import resource
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import httpx
import pytest

from backend.identity import Role
from tests.bridge.viser_page import SUBPROTOCOL
from tests.processes import PATIENCE_S, Robot, eventually

Dialled = tuple[asyncio.StreamReader, asyncio.StreamWriter]
HALF_SENT = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: "


@asynccontextmanager
async def dialled(port: int, count: int = 1, begin: bytes = b"") -> AsyncIterator[list[Dialled]]:
    """So many connections, each of which has sent `begin`."""
    pairs: list[Dialled] = []
    try:
        for _ in range(count):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            pairs.append((reader, writer))
            writer.write(begin)
        yield pairs
    finally:
        for _, writer in pairs:
            writer.transport.abort()


async def ends(pair: Dialled) -> bytes:
    """Read until the bridge has closed the connection."""
    received = b""
    async with asyncio.timeout(PATIENCE_S):
        try:
            while data := await pair[0].read(65536):
                received += data
        except ConnectionError:
            pass
    return received


@pytest.mark.parametrize(
    "begin",
    [
        b"",
        HALF_SENT,
        b"GET /api/me HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\nGET / HTTP/1.1\r\nX-Slow: ",
    ],
    ids=["nothing", "half a request", "a whole one and a half"],
)
async def test_headers_that_do_not_come_in_time_end_the_connection(bridge_with, begin):
    async with bridge_with(bridge={"requests": {"header_timeout": 0.3}}) as bridge:
        async with dialled(bridge.port, 1, begin) as [pair]:
            await ends(pair)
        async with bridge.http() as http:
            assert (await http.get("/api/me")).status_code == 401


async def test_a_drop_now_and_then_does_not_prolong_the_time_for_headers(bridge_with):
    async def drip(writer: asyncio.StreamWriter) -> None:
        while True:
            writer.write(b"x")
            await asyncio.sleep(0.02)

    async with (
        bridge_with(bridge={"requests": {"header_timeout": 0.3}}) as bridge,
        dialled(bridge.port, 1, HALF_SENT) as [pair],
    ):
        dripping = asyncio.create_task(drip(pair[1]))
        await ends(pair)
        dripping.cancel()


@pytest.mark.parametrize("path", ["/api/login", "/api/stop"])
async def test_a_body_that_does_not_come_in_time_ends_the_connection(bridge_with, path):
    async with bridge_with(bridge={"requests": {"body_timeout": 0.3}}) as bridge:
        begin = f"POST {path} HTTP/1.1\r\nHost: 127.0.0.1:{bridge.port}\r\nOrigin: {bridge.origin}\r\n"
        async with dialled(bridge.port, 1, begin.encode() + b"Content-Length: 100\r\n\r\n{") as [pair]:
            await ends(pair)


async def test_headers_have_a_size(bridge):
    async with dialled(bridge.port, 1, HALF_SENT + b"x" * 100_000) as [pair]:
        assert (await ends(pair)).startswith(b"HTTP/1.1 400")


async def test_headers_have_a_size_also_where_they_come_at_once(bridge):
    """h11 looks at the limit only while headers are incomplete."""
    whole = b"GET /api/me HTTP/1.1\r\nHost: 127.0.0.1\r\n" + b"X: y\r\n" * 20_000 + b"\r\n"
    async with dialled(bridge.port, 1, whole) as [pair]:
        assert not (await ends(pair)).startswith(b"HTTP/1.1 401")


async def test_slow_answers_and_open_pages_are_not_cut_off(bridge_with, agent, initialize):
    quick = {"header_timeout": 0.2, "body_timeout": 0.2}
    async with (
        bridge_with(agent={"port": agent.port}, bridge={"requests": quick}) as bridge,
        bridge.websocket() as page,
        dialled(bridge.port) as [silent],
    ):
        await ends(silent)
        await page.send(initialize.decode())
        assert (await agent.heard_message())["method"] == "initialize"


async def test_the_oldest_stranger_makes_room_for_the_next(bridge_with, agent):
    async with (
        bridge_with(agent={"port": agent.port}, bridge={"requests": {"max_before_login": 8}}) as bridge,
        bridge.websocket() as page,
        dialled(bridge.port, 20, HALF_SENT) as strangers,
        bridge.http() as http,
    ):
        assert (await http.get("/api/me")).status_code == 401
        for pair in strangers[:12]:
            await ends(pair)
        await (await page.ping())  # a page is no stranger


async def test_a_connection_with_a_login_is_not_displaced_by_strangers(bridge_with):
    async with bridge_with(bridge={"requests": {"max_before_login": 8}}) as bridge:
        begin = f"GET /api/me HTTP/1.1\r\nHost: 127.0.0.1:{bridge.port}\r\n"
        login = f"Authorization: Bearer {bridge.token()}\r\n\r\n"
        async with dialled(bridge.port, 1, (begin + login).encode()) as [(reader, writer)]:
            async with asyncio.timeout(PATIENCE_S):
                assert (await reader.readuntil(b"}")).startswith(b"HTTP/1.1 200")
            async with dialled(bridge.port, 20, HALF_SENT) as strangers:
                for pair in strangers[:12]:
                    await ends(pair)
                writer.write((begin + login).encode())
                async with asyncio.timeout(PATIENCE_S):
                    assert (await reader.readuntil(b"}")).startswith(b"HTTP/1.1 200")


async def test_a_client_that_leaves_in_the_middle_of_its_login_is_no_error_of_the_bridge(bridge, caplog):
    begin = f"POST /api/login HTTP/1.1\r\nHost: 127.0.0.1:{bridge.port}\r\nContent-Length: 100\r\n\r\n{{"
    async with dialled(bridge.port, 1, begin.encode()):
        await asyncio.sleep(0)
    async with bridge.http() as http:
        for _ in range(20):  # whatever the bridge logs of the one that left, it has logged by then
            assert (await http.get("/api/me")).status_code == 401
    assert caplog.text == ""


async def test_refused_websockets_take_no_room(bridge_with, agent):
    async with bridge_with(agent={"port": agent.port}, bridge={"requests": {"max_before_login": 8}}) as bridge:
        upgrade = (
            f"GET /acp HTTP/1.1\r\nHost: 127.0.0.1:{bridge.port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
        )
        async with dialled(bridge.port, 20, upgrade.encode()) as strangers:
            for pair in strangers:
                await ends(pair)
        async with bridge.websocket() as page:
            await (await page.ping())


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux can lower the limit of another process")
async def test_stop_works_beside_more_half_sent_requests_than_the_bridge_may_open_files(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < 4096:
        pytest.skip("this system does not let the test open 1,100 connections")
    resource.setrlimit(resource.RLIMIT_NOFILE, (4096, hard))
    robot = Robot(tmp_path)
    try:
        with (
            robot.running("robot", "--time-scale", "5", port=robot.robot_port),
            robot.running("bridge", port=robot.bridge_port) as process,
        ):
            resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (1024, 1024))
            headers = {"Authorization": f"Bearer {robot.token('Ana', Role.VIEWER)}"}
            bridge = f"http://127.0.0.1:{robot.bridge_port}"
            async with dialled(robot.bridge_port, 1100, HALF_SENT), dialled(robot.robot_port, 300, HALF_SENT):
                began = time.monotonic()
                async with httpx.AsyncClient(trust_env=False, timeout=PATIENCE_S) as http:
                    answer = await http.post(f"{bridge}/api/stop", headers=headers)
                took = time.monotonic() - began
                assert answer.json()["stopped"]["by"] == "Ana"
                assert took < 1.0, f"the stop took {took:.2f} s"
                assert (await robot.state()).stop is not None
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


async def test_many_small_messages_are_read_a_little_at_a_time_and_no_faster_than_the_pace(
    bridge_with, agent, initialize
):
    pace = {"messages_per_second": 200, "messages_burst": 1000}
    async with (
        bridge_with(agent={"port": agent.port}, bridge={"requests": pace}) as bridge,
        bridge.websocket() as flooding,
        bridge.websocket(token=bridge.token(Role.OPERATOR, "Ben")) as other,
    ):
        await flooding.send(initialize.decode())
        await agent.heard()
        sending = asyncio.create_task(_send_many(flooding, 20_000))
        await eventually(lambda: agent.heard_lines.qsize() >= 500, "the burst")
        await (await other.ping())
        assert agent.heard_lines.qsize() < 15_000
        sending.cancel()
        await asyncio.gather(sending, return_exceptions=True)
        flooding.transport.abort()


async def _send_many(websocket, count):
    for _ in range(count):
        await websocket.send('{"jsonrpc":"2.0","method":"x"}')


async def test_another_connection_of_a_login_in_debt_is_heard_at_once(bridge_with, agent, initialize):
    pace = {"messages_per_second": 0.1, "messages_burst": 100}
    async with bridge_with(agent={"port": agent.port}, bridge={"requests": pace}) as bridge:
        token = bridge.token()
        async with bridge.websocket(token=token) as flooding, bridge.websocket(token=token) as other:
            await flooding.send(initialize.decode())
            await other.send(initialize.decode())
            await agent.heard()
            await agent.heard()
            sending = asyncio.create_task(_send_many(flooding, 5000))
            await eventually(lambda: agent.heard_lines.qsize() >= 90, "the burst")
            await other.send('{"jsonrpc":"2.0","method":"session/cancel","params":{}}')
            async with asyncio.timeout(PATIENCE_S):
                while (await agent.heard_message())["method"] != "session/cancel":
                    pass
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)
            flooding.transport.abort()


@pytest.mark.parametrize(
    ("path", "role"),
    [("/acp", Role.VIEWER), ("/acp", Role.VISITOR), ("/scene", Role.SUPERVISOR), ("/camera", Role.VIEWER)],
)
async def test_one_who_has_nothing_long_to_say_cannot_fill_the_memory(bridge, closing, path, role):
    async with bridge.websocket(path, token=bridge.token(role), subprotocols=[SUBPROTOCOL]) as page:
        await page.send("x" * (2_000_000 if path == "/acp" else 100_000))
        assert (await closing(page))[0] == 1009
