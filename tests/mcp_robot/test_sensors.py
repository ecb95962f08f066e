"""Laser and camera see the map as geometry says."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from PIL import Image

from backend.mcp_robot.grid import FREE, OCCUPIED, OccupancyGrid
from backend.mcp_robot.simulator import camera, laser
from backend.mcp_robot.simulator.world import World
from backend.telemetry import Pose


@pytest.fixture(scope="module")
def room() -> OccupancyGrid:
    """Free floor from (0, 0) to (8, 6), a wall of one cell around it."""
    cells = np.full((122, 162), OCCUPIED, dtype=np.uint8)
    cells[1:-1, 1:-1] = FREE
    return OccupancyGrid(cells, 0.05, -0.05, -0.05)


def test_rays_end_at_the_walls_of_a_room_in_every_direction(room: OccupancyGrid) -> None:
    pose = Pose(2.0, 1.5, 0.7)
    ranges = laser.scan(room, pose)
    for i, measured in enumerate(ranges):
        angle = laser.ANGLE_MIN + i * laser.ANGLE_INCREMENT + pose.yaw
        dx, dy = math.cos(angle), math.sin(angle)
        to_x = ((8.0 - pose.x) if dx > 0 else -pose.x) / dx if abs(dx) > 1e-9 else math.inf
        to_y = ((6.0 - pose.y) if dy > 0 else -pose.y) / dy if abs(dy) > 1e-9 else math.inf
        assert measured == pytest.approx(min(to_x, to_y), abs=0.03)


def test_what_is_out_of_range_reads_as_the_range() -> None:
    empty = OccupancyGrid(np.full((600, 600), FREE, dtype=np.uint8), 0.05, -15.0, -15.0)
    assert np.all(laser.scan(empty, Pose(0.0, 0.0, 0.0)) == laser.RANGE)


def test_noise_is_small_and_the_same_for_the_same_seed(room: OccupancyGrid) -> None:
    pose = Pose(4.0, 3.0, 0.0)
    one, two = (laser.scan(room, pose, np.random.default_rng(5)) for _ in range(2))
    assert np.array_equal(one, two)
    error = one - laser.scan(room, pose)
    assert 0 < np.abs(error).max() < 6 * laser.NOISE


def picture(office: World, pose: Pose) -> np.ndarray:
    with Image.open(io.BytesIO(camera.photograph(office, pose))) as image:
        assert image.format == "JPEG"
        assert image.size == (camera.WIDTH, camera.HEIGHT)
        return np.asarray(image.convert("RGB")).astype(int)


def test_a_photo_shows_ceiling_above_wall_above_floor(office: World) -> None:
    pixels = picture(office, Pose(0.9, 3.1, 0.0))  # across the reception's wooden floor
    brightness = pixels.mean(axis=2).mean(axis=1)
    assert brightness[:60].mean() > brightness[-60:].mean() + 40
    floor = pixels[-40:, 200:440].reshape(-1, 3).mean(axis=0)
    assert floor[0] > floor[2] + 30  # wood is warm


def test_a_nearer_wall_is_taller_in_the_picture(office: World) -> None:
    def floor_rows(x: float) -> int:
        column = picture(office, Pose(x, 7.0, 0.0))[:, 320]
        return int((np.abs(column[camera.HEIGHT // 2 :] - column[-1]).sum(axis=1) < 60).sum())

    assert floor_rows(21.5) < floor_rows(12.0)


def test_turning_by_a_full_circle_gives_the_same_picture(office: World) -> None:
    assert np.array_equal(picture(office, Pose(6.5, 7.0, 0.3)), picture(office, Pose(6.5, 7.0, 0.3 + math.tau)))
