"""The telemetry stream says what the robot does, at the rate asked, and nobody is slowed by a slow reader."""

from __future__ import annotations

import asyncio
import itertools
import statistics
import time
from pathlib import Path

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from backend import telemetry
from backend.mcp_robot.http.camera_feed import RATE
from backend.mcp_robot.navigation.grid import FREE, OCCUPIED, UNKNOWN
from tests.mcp_robot.conftest import Reader, Served, serving


async def test_the_first_message_says_which_robot_and_which_channels(robot: Served) -> None:
    async with connect(f"ws://127.0.0.1:{robot.port}/telemetry", additional_headers=robot.headers) as socket:
        hello = await Reader(socket).next()
    assert hello == telemetry.Hello(telemetry.VERSION, "Sancho", list(telemetry.CHANNELS))


async def test_a_subscription_brings_map_and_path_once_and_state_and_scan_again_and_again(robot: Served) -> None:
    async with robot.telemetry(*(c for c in telemetry.CHANNELS if c != "camera")) as reader:
        seen: list[telemetry.AnyMessage] = [await reader.next() for _ in range(12)]
    kinds = [type(message) for message in seen]
    assert kinds.count(telemetry.Map) == 1
    assert kinds.count(telemetry.Path) == 1
    assert kinds.count(telemetry.State) == kinds.count(telemetry.Scan) == 5
    assert telemetry.Speech not in kinds
    grid = next(message for message in seen if isinstance(message, telemetry.Map))
    assert len(grid.cells) == grid.width * grid.height
    assert set(grid.cells) == {FREE, OCCUPIED, UNKNOWN}
    assert {"dock", "kitchen"} <= {place.name for place in grid.places}
    scan = next(message for message in seen if isinstance(message, telemetry.Scan))
    assert len(scan.ranges) == 360
    behind = scan.ranges[0]  # at -pi: the dock's base, 0.55 m behind the robot's centre
    assert behind == pytest.approx(0.55, abs=0.06)


async def test_pictures_come_while_somebody_looks_and_each_only_once(robot: Served) -> None:
    async with robot.telemetry("camera", rate=60) as one, robot.telemetry("camera", rate=1) as seldom:
        began = time.monotonic()
        pictures = [await one.next() for _ in range(6)]
        took = time.monotonic() - began
        assert all(isinstance(picture, telemetry.Picture) for picture in pictures)
        assert took > 5 / (RATE + 1)
        times = [picture.time for picture in pictures if isinstance(picture, telemetry.Picture)]
        assert times == sorted(set(times))
        assert [p.jpeg[:2] for p in pictures if isinstance(p, telemetry.Picture)] == [b"\xff\xd8"] * 6
        await one.subscribe("state")
        await one.state()
        await seldom.subscribe("state")
        got = 0
        while isinstance(await seldom.next(), telemetry.Picture):
            got += 1
        assert 1 <= got <= time.monotonic() - began + 2


async def test_only_what_was_asked_for_comes(robot: Served) -> None:
    async with robot.telemetry("scan") as reader:
        assert all([isinstance(await reader.next(), telemetry.Scan) for _ in range(5)])
        await reader.subscribe("state")
        await reader.state()
        assert all([isinstance(await reader.next(), telemetry.State) for _ in range(5)])


async def test_states_come_at_about_the_rate_asked_for(robot: Served) -> None:
    async with robot.telemetry("state", rate=10) as reader:
        assert await usual_pause(reader) == pytest.approx(0.1, abs=0.05)


async def usual_pause(reader: Reader) -> float:
    """Seconds between two states, most of the time: a machine that stands for a while does not count."""
    arrived = []
    for _ in range(12):
        await reader.state()
        arrived.append(time.monotonic())
    return statistics.median(after - before for before, after in itertools.pairwise(arrived))


async def test_a_drive_shows_its_path_motion_and_goal_and_then_none(tmp_path: Path) -> None:
    async with (
        serving(tmp_path, time_scale=1.0) as robot,
        robot.mcp() as client,
        robot.telemetry("state", "path") as reader,
    ):
        driving = asyncio.create_task(client.call_tool("navigate_to_place", {"place": "reception"}))
        path = await reader.until(lambda m: getattr(m, "points", None))
        assert not path.preview
        assert path.points[0] == pytest.approx((0.9, 3.1), abs=0.01)
        state = await reader.state(lambda s: s.twist.linear > 0.1)
        assert state.motion is not None
        assert (state.motion.kind, state.motion.place) == ("navigate", "reception")
        assert 0 < state.motion.distance < 5
        assert state.motion.seconds > 0
        await reader.until(lambda m: getattr(m, "points", None) == [])
        await driving
        assert (await reader.state(lambda s: s.motion is None)).twist == telemetry.Twist(0.0, 0.0)


async def test_a_reader_that_sleeps_gets_the_present_afterwards_and_slows_nobody(tmp_path: Path) -> None:
    async with (
        serving(tmp_path, time_scale=1.0) as robot,
        robot.telemetry("state", "scan", rate=60) as lazy,
        robot.telemetry("state", rate=20) as keen,
    ):
        transport = lazy.socket.transport
        transport.pause_reading()  # type: ignore[attr-defined]
        first = (await keen.state()).time
        await keen.state(lambda s: s.time > first + 2.0)
        assert await usual_pause(keen) == pytest.approx(0.05, abs=0.03)
        transport.resume_reading()  # type: ignore[attr-defined]
        newest = (await keen.state()).time
        times = [s.time for s in [await lazy.state() for _ in range(20)]]
        assert times == sorted(times)
        assert (await lazy.state(lambda s: s.time >= newest)).time >= newest


@pytest.mark.parametrize("frame", [b"", b"\xff", b"\x80", "text", telemetry.encode(telemetry.Speech(0, "x", 1))])
async def test_a_frame_that_is_no_subscription_ends_that_connection_alone(robot: Served, frame: bytes | str) -> None:
    async with robot.telemetry("state") as other:
        async with connect(f"ws://127.0.0.1:{robot.port}/telemetry", additional_headers=robot.headers) as socket:
            await socket.recv()
            await socket.send(frame)
            with pytest.raises(ConnectionClosed):
                await socket.recv()
        await other.state()


@pytest.mark.parametrize("rate", [0.0, -5.0, float("nan"), float("inf"), 1e12])
async def test_an_absurd_rate_is_brought_into_range(robot: Served, rate: float) -> None:
    async with robot.telemetry("state", rate=rate) as reader:
        assert (await reader.state()).robot == "Sancho"
