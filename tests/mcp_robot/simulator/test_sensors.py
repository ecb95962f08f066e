"""Laser and camera see the map as geometry says."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from PIL import Image

from backend.mcp_robot.navigation.grid import FREE, OCCUPIED, OccupancyGrid
from backend.mcp_robot.simulator import laser
from backend.mcp_robot.simulator.laser import Laser
from backend.mcp_robot.simulator.rendering import person_sprites, renderer
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
    scanner = Laser(room)
    ranges = scanner.scan(pose)
    for i, measured in enumerate(ranges):
        angle = laser.ANGLE_MIN + i * scanner.increment + pose.yaw
        dx, dy = math.cos(angle), math.sin(angle)
        to_x = ((8.0 - pose.x) if dx > 0 else -pose.x) / dx if abs(dx) > 1e-9 else math.inf
        to_y = ((6.0 - pose.y) if dy > 0 else -pose.y) / dy if abs(dy) > 1e-9 else math.inf
        assert measured == pytest.approx(min(to_x, to_y), abs=0.03)


def test_what_is_out_of_range_reads_as_the_range() -> None:
    empty = OccupancyGrid(np.full((600, 600), FREE, dtype=np.uint8), 0.05, -15.0, -15.0)
    assert np.all(Laser(empty).scan(Pose(0.0, 0.0, 0.0)) == laser.RANGE)


def test_noise_is_small_and_the_same_for_the_same_seed(room: OccupancyGrid) -> None:
    pose = Pose(4.0, 3.0, 0.0)
    one, two = (Laser(room).scan(pose, noise=np.random.default_rng(5)) for _ in range(2))
    assert np.array_equal(one, two)
    error = one - Laser(room).scan(pose)
    assert 0 < np.abs(error).max() < 6 * laser.NOISE


def picture(office: World, pose: Pose, people: tuple[Pose, ...] = ()) -> np.ndarray:
    with Image.open(io.BytesIO(renderer.photograph(office, pose, people))) as image:
        assert image.format == "JPEG"
        assert image.size == (renderer.WIDTH, renderer.HEIGHT)
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
        return int((np.abs(column[renderer.HEIGHT // 2 :] - column[-1]).sum(axis=1) < 60).sum())

    assert floor_rows(21.5) < floor_rows(12.0)


def test_turning_by_a_full_circle_gives_the_same_picture(office: World) -> None:
    assert np.array_equal(picture(office, Pose(6.5, 7.0, 0.3)), picture(office, Pose(6.5, 7.0, 0.3 + math.tau)))


def test_the_laser_sees_a_person_as_a_disc_before_the_wall(room: OccupancyGrid) -> None:
    scanner = Laser(room, rays=720)
    pose = Pose(2.0, 3.0, 0.5)
    empty, ranges = scanner.scan(pose), scanner.scan(pose, [(4.0, 3.0, 0.22)])
    angles = scanner.angles + pose.yaw
    nearer = ranges < empty
    assert ranges[nearer].min() == pytest.approx(2.0 - 0.22, abs=0.01)
    assert np.array_equal(ranges[~nearer], empty[~nearer])
    seen = np.abs(np.arctan2(np.sin(angles[nearer]), np.cos(angles[nearer])))
    assert seen.max() == pytest.approx(math.asin(0.22 / 2.0), abs=scanner.increment)


def test_fewer_rays_are_every_nth_of_all(room: OccupancyGrid) -> None:
    scanner, pose = Laser(room, rays=720), Pose(3.0, 2.0, 1.0)
    assert np.array_equal(scanner.scan(pose, every=4), scanner.scan(pose)[::4])


def test_from_outside_the_map_the_laser_sees_nothing(room: OccupancyGrid) -> None:
    assert np.all(Laser(room).scan(Pose(-3.0, 2.0, 0.0)) == laser.RANGE)


def test_a_photo_shows_people_before_the_wall_and_not_behind_it(office: World) -> None:
    pose = Pose(9.0, 7.0, 0.0)
    nobody = picture(office, pose)
    before = np.abs(picture(office, pose, (Pose(12.0, 7.0, math.pi),)) - nobody).sum(axis=2) > 90
    columns = np.flatnonzero(before.any(axis=0))
    assert abs(columns.mean() - 320) < 15
    tall = renderer.FOCAL * person_sprites.HEIGHT / 3.0
    assert np.ptp(np.flatnonzero(before.any(axis=1))) == pytest.approx(tall, abs=12)
    behind = np.abs(picture(office, pose, (Pose(12.0, 4.0, 0.0),)) - nobody)
    assert behind.max() < 40  # JPEG


def test_a_photo_shows_a_closed_door(office: World) -> None:
    pose = Pose(11.6, 7.2, -math.pi / 2)
    shut = picture(office.with_closed(["lab-2.3.7"]), pose)[150:300, 300:340].reshape(-1, 3).mean(axis=0)
    assert shut[0] > shut[2] + 40  # of wood
