"""A real robot server on a free port of the loopback, a real MCP client, and a telemetry reader."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from mcp import Client
from mcp.client.streamable_http import streamable_http_client
from mcp.shared._httpx_utils import create_mcp_http_client
from websockets.asyncio.client import ClientConnection, connect

from backend import config, identity, telemetry
from backend.mcp_robot import robots, server
from backend.mcp_robot.ros2.waiting import Waits
from backend.mcp_robot.simulator import world as worlds
from backend.mcp_robot.simulator.world import World
from tests.ros2_robots import PATIENT, WAITS, StandIns, needs_ros2

TIME_LIMIT = 30.0
UNHURRIED = {"pose_timeout": 10.0, "client_silence": 30.0}
"""Limits that a machine that stands for some seconds does not reach; what they do is for the tests that set them."""
DOCK = telemetry.Pose(0.9, 3.1, 0.0)


@dataclass
class Served:
    """A robot server that answers: where it is and how to reach it."""

    port: int
    token: str

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    @property
    def headers(self) -> dict[str, str]:
        return {"Authorization": f"Bearer {self.token}"}

    def http(self) -> httpx.AsyncClient:
        return httpx.AsyncClient(base_url=self.url, headers=self.headers, timeout=TIME_LIMIT)

    @contextlib.asynccontextmanager
    async def mcp(self, mode: str = "auto") -> AsyncIterator[Client]:
        try:
            async with (
                create_mcp_http_client(headers=self.headers) as http,
                Client(streamable_http_client(f"{self.url}/mcp", http_client=http), mode=mode) as client,
            ):
                yield client
        except BaseExceptionGroup as group:
            raise the_one(group) from None

    @contextlib.asynccontextmanager
    async def telemetry(self, *channels: telemetry.Channel, rate: float = 20.0) -> AsyncIterator[Reader]:
        address = f"ws://127.0.0.1:{self.port}/telemetry"
        # No limit on what lies unread: with one, a test that stops reading waits ten seconds for its own close.
        async with connect(address, additional_headers=self.headers, max_queue=None) as socket:
            reader = Reader(socket)
            assert isinstance(await reader.next(), telemetry.Hello)
            await reader.subscribe(*channels, rate=rate)
            yield reader


def the_one(failure: BaseException) -> BaseException:
    """What went wrong in a test's body, out of the groups that a client's task groups put it in."""
    while isinstance(failure, BaseExceptionGroup) and len(failure.exceptions) == 1:
        failure = failure.exceptions[0]
    return failure


class Reader:
    """A reader of the telemetry stream."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket

    async def subscribe(self, *channels: telemetry.Channel, rate: float = 20.0) -> None:
        await self.socket.send(telemetry.encode(telemetry.Subscribe(list(channels), rate)))

    async def next(self) -> telemetry.AnyMessage:
        # Not wait_for: before Python 3.12 it can swallow the cancellation of a time limit around it.
        async with asyncio.timeout(TIME_LIMIT):
            frame = await self.socket.recv()
        assert isinstance(frame, bytes)
        return telemetry.decode(frame)

    async def until(self, wanted: Callable[[Any], bool]) -> Any:
        """The first message for which `wanted` holds."""
        async with asyncio.timeout(TIME_LIMIT):
            while True:
                message = await self.next()
                if wanted(message):
                    return message

    async def state(self, wanted: Callable[[telemetry.State], bool] = lambda _: True) -> telemetry.State:
        found = await self.until(lambda m: isinstance(m, telemetry.State) and wanted(m))
        assert isinstance(found, telemetry.State)
        return found


CONTRACT = {"test_tools", "test_stop", "test_telemetry_stream", "test_halted", "test_preview"}
"""Modules whose tests hold for any robot: they are run against each, unchanged."""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if metafunc.module.__name__.rpartition(".")[2] in CONTRACT:
        ros2 = pytest.param("ros2", marks=needs_ros2)
        metafunc.parametrize("kind", ["simulator", ros2], indirect=True)


_stand_ins: StandIns | None = None  # set while a test is about the ROS 2 robot


@pytest.fixture(scope="session")
def stand_ins(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StandIns]:
    stand_ins = StandIns(tmp_path_factory.mktemp("stand-ins"))
    yield stand_ins
    stand_ins.close()


@pytest.fixture(autouse=True)
def kind(request: pytest.FixtureRequest) -> Iterator[str]:
    """Which robot `serving` serves in this test."""
    global _stand_ins
    kind = getattr(request, "param", "simulator")
    _stand_ins = request.getfixturevalue("stand_ins") if kind == "ros2" else None
    yield kind
    _stand_ins = None


@contextlib.asynccontextmanager
async def serving(data_dir: Path, **robot: Any) -> AsyncIterator[Served]:
    """Serve a robot while inside, of the kind that the test is about."""
    robot["limits"] = UNHURRIED | robot.get("limits", {})
    if _stand_ins is None:
        async with served(data_dir, **robot) as answering:
            yield answering
        return
    with _stand_ins.one("--time-scale", str(robot.get("time_scale", 20.0))) as stand_in:
        ros2 = PATIENT | {"demo": True, "domain_id": stand_in.domain}
        async with served(data_dir, kind="ros2", ros2=ros2, **robot) as answering:
            yield answering
            stand_in.untouched = "time_scale" not in robot and await _is_as_new(answering)


async def _is_as_new(robot: Served) -> bool:
    """Whether another test may find the robot as this one leaves it: at its dock, at rest and not stopped."""
    async with robot.telemetry("state") as reader:
        state = await reader.state()
    at_rest = state.twist == telemetry.Twist(0.0, 0.0) and not (state.motion or state.speaking or state.stop)
    return at_rest and state.pose == DOCK and state.battery.level < 0.97


@contextlib.asynccontextmanager
async def served(data_dir: Path, waits: Waits = WAITS, **robot: Any) -> AsyncIterator[Served]:
    """Run `serve` in this process while inside; `waits` are those of a ROS 2 robot."""
    settings = config.Settings(data_dir=data_dir, robot=config.Robot(**{"port": 0, "time_scale": 20.0, **robot}))
    ready: asyncio.Future[int] = asyncio.get_running_loop().create_future()
    built = robots.ros2(settings, waits) if settings.robot.kind == "ros2" else None
    task = asyncio.create_task(server.serve(settings, on_ready=ready.set_result, built=built))
    await asyncio.wait({task, ready}, return_when=asyncio.FIRST_COMPLETED, timeout=TIME_LIMIT)
    if task.done():
        task.result()
    token = identity.shared_secret(data_dir, identity.ROBOT_TOKEN).decode()
    try:
        yield Served(ready.result(), token)
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


@pytest.fixture(scope="session")
def office() -> World:
    return worlds.load("office")


@pytest.fixture
async def robot(tmp_path: Path) -> AsyncIterator[Served]:
    """A server whose time runs 20 times as fast as the wall's."""
    async with serving(tmp_path) as served:
        yield served
