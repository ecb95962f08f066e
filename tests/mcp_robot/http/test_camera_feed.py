"""The camera as telemetry, where it is not as it should be."""

from __future__ import annotations

import asyncio
import math
import threading
from pathlib import Path

import pytest

from backend.config import Limits
from backend.mcp_robot.http.camera_feed import CameraFeed
from backend.mcp_robot.motion.pilot import Pilot
from backend.mcp_robot.motion.stop import StopLatch
from backend.mcp_robot.robot import Picture
from backend.mcp_robot.simulator.simulated_robot import SimulatedRobot
from backend.mcp_robot.simulator.world import World
from tests.processes import eventually


async def test_a_camera_that_fails_is_tried_again(office: World, tmp_path: Path) -> None:
    class Shaky(SimulatedRobot):
        asked = 0

        async def photo(self) -> Picture:
            self.asked += 1
            if self.asked < 3:
                raise TimeoutError
            return await super().photo()

    robot = Shaky(office, Limits())
    feed = CameraFeed(Pilot(robot, StopLatch(tmp_path), Limits()), lambda: None, retry_after=0.05)
    feed.watch(somebody := object())
    await eventually(lambda: feed.latest, "a picture")
    assert robot.asked >= 3
    feed.unwatch(somebody)
    assert feed.latest is None


@pytest.mark.parametrize(("repeat_after", "sent"), [(math.inf, 1), (0.0, 4)])
async def test_a_picture_that_has_not_changed_is_sent_again_only_now_and_then(
    office: World, tmp_path: Path, repeat_after: float, sent: int
) -> None:
    seen: list[bytes] = []

    class Still(SimulatedRobot):
        shots = 0

        async def photo(self) -> Picture:
            self.shots += 1
            return Picture(b"same" if self.shots < 5 else b"else", 640, 480, self.simulation.believed)

    robot = Still(office, Limits())
    pilot = Pilot(robot, StopLatch(tmp_path), Limits())
    feed = CameraFeed(pilot, lambda: seen.append(feed.latest or b""), rate=100.0, repeat_after=repeat_after)
    feed.watch(somebody := object())
    await eventually(lambda: any(b"else" in frame for frame in seen), "the other picture")
    feed.unwatch(somebody)
    assert sum(b"same" in frame for frame in seen) == sent


async def test_pictures_that_are_asked_for_together_are_drawn_by_one_thread(office: World) -> None:
    robot = SimulatedRobot(office, Limits())
    before = set(threading.enumerate())
    pictures = await asyncio.gather(*(robot.photo() for _ in range(4)))
    assert all(picture.jpeg for picture in pictures)
    assert len(set(threading.enumerate()) - before) == 1
