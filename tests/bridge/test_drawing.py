"""Obstacles that the laser sees and the map does not explain, the robot's trail, and zones on the floor."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from backend.bridge.scene.drawing import trail, zones
from backend.bridge.scene.drawing.obstacle_detection import (
    MAX_OBSTACLES,
    ExplainedMap,
    Obstacle,
    ObstacleTracker,
    detect,
    dilate,
)
from backend.telemetry import Map, Pose, Zone

MASKS = arrays.arrays(np.bool_, st.tuples(st.integers(1, 12), st.integers(1, 12)))
HERE = Pose(5.0, 5.0, 0.0)


def room(cells: np.ndarray | None = None) -> Map:
    """10 m by 10 m with walls around; 10 cm a cell."""
    grid = np.zeros((100, 100), np.uint8) if cells is None else cells
    grid[[0, -1], :] = grid[:, [0, -1]] = 100
    return Map(0.1, 100, 100, 0.0, 0.0, grid.tobytes(), [])


def around(x: float, y: float, radius: float, readings: int = 12) -> np.ndarray:
    """What a laser at HERE sees of a round thing: the side that faces it."""
    facing = math.atan2(HERE.y - y, HERE.x - x)
    angles = facing + np.linspace(-1.2, 1.2, readings)
    return np.column_stack([x + radius * np.cos(angles), y + radius * np.sin(angles)])


@settings(deadline=None)
@given(MASKS, st.integers(0, 5))
def test_a_dilation_is_what_lies_within_the_radius_of_a_true_cell(mask, radius):
    at = np.argwhere(mask)
    for row, column in np.ndindex(mask.shape):
        distance = min((math.dist(cell, (row, column)) for cell in at), default=math.inf)
        assert dilate(mask, radius)[row, column] == (distance <= radius)


def test_a_person_is_one_post_where_the_person_stands():
    (obstacle,) = detect(around(7.0, 6.0, 0.22), HERE, ExplainedMap(room()))
    assert (obstacle.x, obstacle.y) == pytest.approx((7.0, 6.0), abs=0.12)
    assert obstacle.radius == pytest.approx(0.22, abs=0.05)


def test_what_the_map_explains_is_no_obstacle():
    wall = np.column_stack([np.full(40, 9.85), np.linspace(2, 8, 40)])
    assert detect(wall, HERE, ExplainedMap(room())) == []
    pillar = np.zeros((100, 100), np.uint8)
    pillar[68:72, 68:72] = 100
    assert detect(around(7.0, 7.0, 0.3), HERE, ExplainedMap(room(pillar))) == []


def test_what_is_unknown_or_off_the_map_is_no_obstacle_and_neither_is_one_reading_alone():
    unknown = np.zeros((100, 100), np.uint8)
    unknown[:, 50:] = 255
    assert detect(around(7.0, 6.0, 0.22), HERE, ExplainedMap(room(unknown))) == []
    assert detect(around(-3.0, 5.0, 0.22), HERE, ExplainedMap(room())) == []
    assert detect(np.array([[3.0, 3.0]]), HERE, ExplainedMap(room())) == []
    assert detect(np.zeros((0, 2)), HERE, ExplainedMap(room())) == []


def test_two_people_are_two_posts_and_a_closed_door_is_several():
    known = ExplainedMap(room())
    two = detect(np.concatenate([around(7.0, 3.0, 0.22), around(7.0, 6.0, 0.22)]), HERE, known)
    assert len(two) == 2
    door = np.column_stack([np.full(30, 7.0), np.linspace(4.0, 6.0, 30)])
    obstacles = detect(door, HERE, known)
    assert 2 <= len(obstacles) <= 4
    assert all(abs(obstacle.x - 7.0) < 0.3 for obstacle in obstacles)


def test_what_stands_where_a_scan_begins_and_ends_is_one():
    points = around(3.0, 5.0, 0.22)
    assert len(detect(np.roll(points, 6, axis=0), HERE, ExplainedMap(room()))) == 1


def test_a_crowd_is_the_nearest_ones():
    obstacles = detect(
        np.concatenate([around(x, y, 0.05, 4) for x in np.arange(1, 9, 0.8) for y in np.arange(1, 9, 0.8)]),
        HERE,
        ExplainedMap(room()),
    )
    assert len(obstacles) == MAX_OBSTACLES
    distances = [math.dist((obstacle.x, obstacle.y), (5, 5)) for obstacle in obstacles]
    assert distances == sorted(distances)
    assert distances[-1] < 3.5


def test_a_post_keeps_its_place_while_it_moves_and_two_do_not_change_places():
    obstacles = ObstacleTracker()
    obstacles.update([Obstacle(1, 1, 0.2), Obstacle(3, 1, 0.2)], now=0.0)
    first, second = (obstacles.slots.index(Obstacle(x, 1, 0.2)) for x in (1, 3))
    obstacles.update([Obstacle(2.8, 1, 0.2), Obstacle(1.2, 1, 0.2)], now=0.1)
    assert (obstacles.slots[first], obstacles.slots[second]) == (Obstacle(1.2, 1, 0.2), Obstacle(2.8, 1, 0.2))


def test_a_post_that_hardly_moves_is_left_alone():
    obstacles = ObstacleTracker()
    obstacles.update([Obstacle(1, 1, 0.2)], now=0.0)
    obstacles.update([Obstacle(1.02, 1.01, 0.22)], now=0.1)
    assert obstacles.slots[0] == Obstacle(1, 1, 0.2)


def test_a_post_that_is_not_seen_any_more_is_gone_after_a_moment():
    obstacles = ObstacleTracker()
    obstacles.update([Obstacle(1, 1, 0.2)], now=0.0)
    obstacles.update([], now=0.2)
    assert obstacles.slots[0] == Obstacle(1, 1, 0.2)
    obstacles.update([], now=0.5)
    assert not any(obstacles.slots)


@settings(deadline=None)
@given(st.lists(st.lists(st.tuples(st.floats(0, 5), st.floats(0, 5)), max_size=40), max_size=8))
def test_there_are_never_more_posts_than_places(rounds):
    obstacles = ObstacleTracker()
    for number, points in enumerate(rounds):
        obstacles.update([Obstacle(x, y, 0.2) for x, y in points][:MAX_OBSTACLES], now=number * 0.1)
        assert len(obstacles.slots) == MAX_OBSTACLES


def drive(record: trail.Trail, *xs: float) -> list[int]:
    """The pieces that changed while the robot drove along x."""
    return [piece for x in xs if (piece := record.add(Pose(x, 0.0, 0.0))) is not None]


def test_the_trail_has_a_point_each_step_and_standing_adds_none():
    record = trail.Trail()
    assert drive(record, *np.arange(0.0, 1.01, 0.05)) == [0, 0, 0, 0]
    assert drive(record, 1.0, 1.0, 1.01) == []
    assert record.pieces[0] == [pytest.approx((x, 0.0)) for x in (0, 0.25, 0.5, 0.75, 1)]


def test_a_piece_that_is_full_is_continued_where_it_ended_and_changes_no_more():
    record = trail.Trail()
    changed = drive(record, *(np.arange(trail.POINTS_PER_PIECE + 5) * 0.25))
    assert changed[-1] == 1
    assert record.pieces[1][0] == record.pieces[0][-1]
    assert len(record.pieces[0]) == trail.POINTS_PER_PIECE


def test_the_trail_is_bounded_and_forgets_its_begin():
    record = trail.Trail()
    drive(record, *(np.arange(3 * trail.PIECES * trail.POINTS_PER_PIECE) * 0.25))
    assert sum(map(len, record.pieces)) <= trail.PIECES * trail.POINTS_PER_PIECE
    assert min(x for piece in record.pieces for x, _ in piece) > 100


def test_a_robot_that_was_set_down_elsewhere_leaves_no_line_through_the_walls():
    record = trail.Trail()
    drive(record, 0.0, 0.3, 9.0, 9.3)
    assert record.pieces[:2] == [[(0.0, 0.0), (0.3, 0.0)], [(9.0, 0.0), (9.3, 0.0)]]
    record.clear()
    assert not any(record.pieces)


def test_a_zone_is_painted_where_it_is_and_nowhere_else():
    white = np.full((100, 100, 3), 255, np.uint8)  # 10 m, 10 cm a pixel, from (-5, -5)
    picture = white.copy()
    zones.paint(picture, [Zone("store", [(-4, 1), (-1, 1), (-1, 4), (-4, 4)])], 0.1, (-5.0, -5.0))
    red = picture[:, :, 1] < 255
    rows, columns = np.flatnonzero(red.any(axis=1)), np.flatnonzero(red.any(axis=0))
    assert (columns[0], columns[-1], rows[0], rows[-1]) == pytest.approx((10, 40, 60, 90), abs=1)
    assert red[61:90, 11:40].all()
    assert len(np.unique(picture[65:85, 15:35, 1])) == 2  # stripes


def test_zones_that_reach_beyond_the_map_or_are_none_do_no_harm():
    picture = np.full((20, 20, 3), 255, np.uint8)
    zones.paint(picture, [Zone("line", [(0, 0), (1, 1)]), Zone("far", [(50, 50), (60, 50), (60, 60)])], 0.1, (0, 0))
    assert (picture == 255).all()
    zones.paint(picture, [Zone("all", [(-9, -9), (9, -9), (9, 9), (-9, 9)])], 0.1, (0, 0))
    assert (picture[:, :, 1] < 255).all()


def test_a_zone_is_named_in_its_middle():
    assert zones.centroid([(0, 0), (4, 0), (4, 2), (0, 2)]) == pytest.approx((2, 1))
    assert zones.centroid([(0, 0), (0, 2), (4, 2), (4, 0)]) == pytest.approx((2, 1))
    assert zones.centroid([(1, 1), (3, 3)]) == pytest.approx((2, 2))
