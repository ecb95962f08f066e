"""The camera as telemetry, where it is not as it should be."""

from __future__ import annotations

import asyncio
import math
import threading
from pathlib import Path

import pytest

from backend.config import Limits
from backend.mcp_robot.http import camera_feed
from backend.mcp_robot.http.camera_feed import CameraFeed
from backend.mcp_robot.motion.pilot import Pilot
from backend.mcp_robot.motion.stop import StopLatch
from backend.mcp_robot.robot import Picture
from backend.mcp_robot.simulator.simulated_robot import SimulatedRobot
from backend.mcp_robot.simulator.world import World
from tests.processes import eventually


async def test_a_camera_that_fails_is_asked_again(
    office: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(camera_feed, "RETRY", 0.05)

    class Shaky(SimulatedRobot):
        asked = 0

        async def photo(self) -> Picture:
            self.asked += 1
            if self.asked < 3:
                raise TimeoutError
            return await super().photo()

    robot = Shaky(office, Limits())
    feed = CameraFeed(Pilot(robot, StopLatch(tmp_path), Limits()), lambda: None)
    feed.look(somebody := object())
    await eventually(lambda: feed.latest, "a picture")
    assert robot.asked >= 3
    feed.look_away(somebody)
    assert feed.latest is None


@pytest.mark.parametrize(("still", "told"), [(math.inf, 1), (0.0, 4)])
async def test_what_looks_the_same_is_told_again_only_now_and_then(
    office: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, still: float, told: int
) -> None:
    monkeypatch.setattr(camera_feed, "RATE", 100.0)
    monkeypatch.setattr(camera_feed, "STILL", still)
    seen: list[bytes] = []

    class Still(SimulatedRobot):
        shots = 0

        async def photo(self) -> Picture:
            self.shots += 1
            return Picture(b"same" if self.shots < 5 else b"else", 640, 480, self.simulation.believed)

    robot = Still(office, Limits())
    feed = CameraFeed(Pilot(robot, StopLatch(tmp_path), Limits()), lambda: seen.append(feed.latest or b""))
    feed.look(somebody := object())
    await eventually(lambda: any(b"else" in frame for frame in seen), "the other picture")
    feed.look_away(somebody)
    assert sum(b"same" in frame for frame in seen) == told


async def test_pictures_that_are_asked_for_together_are_drawn_by_one_thread(office: World) -> None:
    robot = SimulatedRobot(office, Limits())
    before = set(threading.enumerate())
    pictures = await asyncio.gather(*(robot.photo() for _ in range(4)))
    assert all(picture.jpeg for picture in pictures)
    assert len(set(threading.enumerate()) - before) == 1
