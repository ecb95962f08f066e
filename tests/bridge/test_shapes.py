"""The scene's geometry: walls, floor, paths, laser points, and the views of the whole map."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from backend.bridge.scene.drawing import camera_views, robot_model, shapes
from backend.telemetry import Pose, Scan

calmly = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
"""A busy machine is no failure."""

MASKS = arrays.arrays(np.bool_, st.tuples(st.integers(1, 12), st.integers(1, 12)))


@calmly
@given(MASKS)
def test_rectangles_cover_every_occupied_cell_once_and_no_other(mask):
    covered = np.zeros(mask.shape, int)
    for row, column, rows, columns in shapes.rectangles(mask):
        covered[row : row + rows, column : column + columns] += 1
    assert (covered == mask).all()


def test_a_wall_of_many_cells_is_one_rectangle():
    mask = np.zeros((40, 60), bool)
    mask[5:8, 3:50] = True
    assert shapes.rectangles(mask) == [(5, 3, 3, 47)]


def test_walls_stand_where_the_map_has_them():
    mask = np.zeros((4, 6), bool)
    mask[1, 2:5] = True
    sides, tops = shapes.walls(mask, 0.5, (-1.0, 10.0), height=0.7)
    assert sides.vertices.min(axis=0) == pytest.approx([0.0, 10.5, 0.0])
    assert sides.vertices.max(axis=0) == pytest.approx([1.5, 11.0, 0.7])
    assert len(tops.faces) == 2
    assert len(sides.faces) == 8


@pytest.mark.parametrize("part", robot_model.parts((0, 0, 0), (1, 1, 1), (2, 2, 2)) + robot_model.goal((3, 3, 3)))
def test_every_body_is_a_sound_mesh(part):
    assert part.mesh.faces.max() < len(part.mesh.vertices)
    assert np.isfinite(part.mesh.vertices).all()
    assert part.mesh.vertices[:, 2].min() >= 0


def test_flat_bodies_are_seen_from_above_and_round_ones_from_outside():
    def normals(mesh):
        a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
        return np.cross(b - a, c - a), (a + b + c) / 3

    for flat in (shapes.ring(0.4, 0.5, 0.0), shapes.polygon([(0, 0), (1, 0), (0, 1)], 0.0)):
        across, _ = normals(flat)
        assert (across[:, 2] > 0).all()
    across, middle = normals(shapes.lathe([(0.2, 0.0), (0.2, 1.0)]))
    assert (np.sum(across[:, :2] * middle[:, :2], axis=1) > 0).all()
    across, middle = normals(shapes.box((-1, -1, -1), (1, 1, 1)))
    assert (np.sum(across * middle, axis=1) > 0).all()


def test_the_floor_picture_begins_at_the_smallest_y_and_tells_known_from_unknown():
    cells = np.full((3, 2), 255, np.uint8)
    cells[0] = 0  # the smallest y
    picture = shapes.floor_picture(
        cells, 0.05, (0.02, 0.02), free=(9, 9, 9), line=(5, 5, 5), outside=(1, 1, 1), scale=2
    )
    assert picture.shape == (6, 4, 3)
    assert (picture[:2] == 9).all()
    assert (picture[2:] == 1).all()


def test_the_floor_has_a_fine_line_each_metre():
    cells = np.zeros((40, 60), np.uint8)
    picture = shapes.floor_picture(cells, 0.05, (0.0, 0.0), free=(9, 9, 9), line=(5, 5, 5), outside=(1, 1, 1), scale=3)
    columns = (picture[50] == 5).all(axis=1)
    at = np.flatnonzero(columns) * 0.05 / 3
    assert {round(float(x)) for x in at} == {0, 1, 2, 3}
    assert columns.sum() <= 8


def test_the_extent_is_what_is_known():
    cells = np.full((10, 20), 255, np.uint8)
    cells[2:5, 3:9] = 0
    assert shapes.extent(cells, 0.5, (1.0, 2.0)) == pytest.approx((2.5, 3.0, 5.5, 4.5))
    unknown = np.full((10, 20), 255, np.uint8)
    assert shapes.extent(unknown, 0.5, (0.0, 0.0)) == pytest.approx((0.0, 0.0, 10.0, 5.0))


def test_a_path_is_its_segments_and_no_path_is_one_of_no_length():
    segments = shapes.segments_of([(0, 0), (1, 0), (1, 2)], z=0.1)
    assert segments.shape == (2, 2, 3)
    assert segments[1] == pytest.approx(np.array([[1, 0, 0.1], [1, 2, 0.1]]))
    for none in ([], [(1.0, 1.0)]):
        assert shapes.segments_of(none, 0.1).shape == (1, 2, 3)


def test_laser_points_are_where_the_map_has_what_the_readings_hit():
    ranges = [2.0, 10.0, 3.0, math.inf, math.nan, 0.0]
    scan = Scan(0.0, Pose(10.0, 20.0, math.pi / 2), 0.0, math.pi / 2, 10.0, ranges)
    assert shapes.hits(scan, z=0.3) == pytest.approx(np.array([[10, 22, 0.3], [10, 17, 0.3]]), abs=1e-5)


def seen(view: camera_views.View, point: tuple[float, float, float], aspect: float) -> bool:
    position, look_at = np.array(view.position), np.array(view.look_at)
    forward = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    relative = np.array(point) - position
    depth = relative @ forward
    slope = math.tan(camera_views.FIELD_OF_VIEW / 2)
    return bool(
        depth > 0
        and abs(relative @ up) <= depth * slope + 1e-6
        and abs(relative @ right) <= depth * slope * aspect + 1e-6
    )


@calmly
@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(1, 80), st.floats(1, 80), st.floats(0.3, 4.0))
def test_the_whole_map_is_seen_in_every_pane(x, y, width, depth, aspect):
    view = camera_views.map_view((x, y, x + width, y + depth), aspect)
    for corner in [(x, y), (x + width, y), (x, y + depth), (x + width, y + depth)]:
        for z in (0.0, 1.25):
            assert seen(view, (*corner, z), aspect)
    assert view.look_at[2] == pytest.approx(0, abs=1e-6)


def test_the_map_fills_the_pane_that_it_is_fitted_to():
    near = camera_views.map_view((0, 0, 24, 12), 1.2)
    closer = camera_views.View(
        tuple(p + 0.12 * (q - p) for p, q in zip(near.position, near.look_at, strict=True)), near.look_at
    )
    corners = [(x, y, 0.0) for x in (0, 24) for y in (0, 12)]
    assert not all(seen(closer, corner, 1.2) for corner in corners)


def test_a_tall_pane_looks_along_the_long_side_of_the_map():
    wide, tall = camera_views.map_view((0, 0, 24, 12), 1.5), camera_views.map_view((0, 0, 24, 12), 0.5)
    assert wide.position[0] == pytest.approx(12)
    assert tall.position[1] == pytest.approx(6)
