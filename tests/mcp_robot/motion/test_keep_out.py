"""Keep-out zones: where the robot's footprint must not be, it is not sent, not led through, and not planned."""

from __future__ import annotations

import contextlib
import itertools
import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from backend import config
from backend.mcp_robot.motion import keep_out, safety
from backend.mcp_robot.navigation.grid import FREE, KEEP_OUT, OCCUPIED, OccupancyGrid
from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.simulator import world as worlds
from backend.mcp_robot.simulator.world import BUILT_IN, World, WorldError
from backend.telemetry import Map, Pose, Zone
from tests.mcp_robot.conftest import serving
from tests.mcp_robot.tools.test_tools import call, refused

SQUARE = Zone("square", [(1.0, 1.0), (3.0, 1.0), (3.0, 2.0), (1.0, 2.0)])
ARROW = Zone("arrow", [(5.0, 1.0), (7.0, 3.0), (5.0, 5.0), (6.0, 3.0)])
RADIUS = 0.25


@pytest.fixture
def hall() -> OccupancyGrid:
    """An empty hall of 10 m by 6 m with walls around."""
    cells = np.full((120, 200), FREE, dtype=np.uint8)
    cells[[0, -1], :] = cells[:, [0, -1]] = OCCUPIED
    return OccupancyGrid(cells, 0.05, 0.0, 0.0)


@pytest.mark.parametrize(
    ("point", "distance", "name"),
    [
        ((0.0, 1.5), 1.0, "square"),
        ((2.0, 2.5), 0.5, "square"),
        ((0.0, 0.0), math.sqrt(2), "square"),
        ((2.0, 1.4), -0.4, "square"),
        ((6.5, 3.0), -0.5 / math.sqrt(5), "arrow"),
        ((5.2, 3.0), 0.8 / math.sqrt(5) * 2, "arrow"),
    ],
    ids=["beside", "above", "off a corner", "inside", "inside the point", "in its notch"],
)
def test_the_distance_to_a_zone_is_exact_and_negative_inside(
    point: tuple[float, float], distance: float, name: str
) -> None:
    near = keep_out.nearest([SQUARE, ARROW], *point)
    assert near is not None
    assert near[0] == pytest.approx(distance, abs=0.2 if name == "arrow" and distance < 0 else 1e-9)
    assert near[1].name == name
    assert keep_out.distances([SQUARE, ARROW], np.array([point]))[0] == near[0]


def test_without_zones_everything_is_far(hall: OccupancyGrid) -> None:
    assert keep_out.nearest([], 1, 1) is None
    assert keep_out.distances([], np.zeros((3, 2))).tolist() == [math.inf] * 3
    assert keep_out.applied(hall, []) is hall


def test_every_cell_that_a_zone_touches_is_marked_and_no_other(hall: OccupancyGrid) -> None:
    marked = keep_out.applied(hall, [SQUARE, ARROW])
    assert (hall.cells != KEEP_OUT).all()
    rows, columns = np.nonzero(marked.cells == KEEP_OUT)
    centres = (np.stack([columns, rows], axis=1) + 0.5) * 0.05
    assert (keep_out.distances([SQUARE, ARROW], centres) <= 0.05 * math.sqrt(0.5) + 1e-9).all()
    inside = np.random.default_rng(1).uniform((0.1, 0.1), (9.9, 5.9), (20_000, 2))
    inside = inside[keep_out.distances([SQUARE, ARROW], inside) < 0]
    assert len(inside) > 1000
    assert all(marked.state(x, y) == KEEP_OUT for x, y in inside)


def test_a_zone_that_leaves_the_map_or_lies_outside_marks_what_is_there(hall: OccupancyGrid) -> None:
    over = keep_out.applied(hall, [Zone("over", [(9.0, 5.0), (20.0, 5.0), (20.0, 30.0), (9.0, 30.0)])])
    assert over.state(9.5, 5.5) == KEEP_OUT
    assert over.state(9.99, 5.99) == OCCUPIED
    off = keep_out.applied(hall, [Zone("off", [(50.0, 5.0), (60.0, 5.0), (60.0, 30.0)])])
    assert (off.cells == hall.cells).all()


def test_a_zone_that_reaches_far_beyond_the_map_is_marked_as_any_other(hall: OccupancyGrid) -> None:
    """Its sides were sampled to their ends: a zone of a million metres took all memory."""
    far = 1e6
    all_of_it = keep_out.applied(hall, [Zone("all", [(-far, -far), (far, -far), (far, far), (-far, far)])])
    assert not (all_of_it.cells == FREE).any()
    band = Zone("band", [(-far, 2.0), (far, 2.0), (far, 3.0), (-far, 3.0)])
    near = Zone("near", [(-9.0, 2.0), (99.0, 2.0), (99.0, 3.0), (-9.0, 3.0)])
    assert np.array_equal(keep_out.applied(hall, [band]).cells, keep_out.applied(hall, [near]).cells)
    past = Zone("past", [(far, 0.0), (far, 9.0), (2 * far, 4.0)])
    assert np.array_equal(keep_out.applied(hall, [past]).cells, hall.cells)


def test_a_goal_whose_footprint_would_touch_a_zone_is_refused_with_its_name(hall: OccupancyGrid) -> None:
    for x, words in ((2.0, "is in"), (3.3, "is too close to")):
        with pytest.raises(
            Refusal, match=rf"^keep_out: The goal .* {words} the keep-out zone square. Choose"
        ) as refusal:
            safety.goal_keeps_out([SQUARE], hall, Pose(x, 1.5, 0.0), RADIUS)
        near = tuple(map(float, refusal.value.sentence.rpartition("(")[2].rstrip(").").split(", ")))
        safety.goal_keeps_out([SQUARE], hall, Pose(*near, 0.0), RADIUS)
        safety.goal_is_free(keep_out.applied(hall, [SQUARE]), Pose(*near, 0.0), RADIUS)
    safety.goal_keeps_out([SQUARE], hall, Pose(3.5, 1.5, 0.0), RADIUS)


@pytest.mark.parametrize(
    ("points", "code"),
    [
        ([(0.5, 1.5), (4.0, 1.5)], "keep_out"),
        ([(0.5, 2.2), (4.0, 2.2)], "keep_out"),
        ([(0.5, 2.5), (4.0, 2.5)], None),
        ([(0.5, 0.5), (0.1, 0.5), (0.5, 5.0)], "occupied"),
        ([(0.5, 0.5), (-3.0, 0.5)], "occupied"),
        ([(1.5, 1.9), (1.5, 2.6), (5.0, 2.6)], None),
        ([(1.5, 1.9), (1.5, 1.2), (1.5, 0.4)], "keep_out"),
        ([(9.87, 3.0), (9.0, 3.0)], None),
    ],
    ids=[
        "through a zone", "touching a zone", "past a zone", "along a wall", "off the map",
        "out of a zone", "deeper into a zone", "off a wall",
    ],
)  # fmt: skip
def test_a_planned_path_is_looked_at_point_by_point(
    hall: OccupancyGrid, points: list[tuple[float, float]], code: str | None
) -> None:
    dense = np.concatenate([np.linspace(a, b, 60) for a, b in itertools.pairwise(points)])
    with pytest.raises(Refusal, match=f"^{code}: ") if code else contextlib.nullcontext():
        safety.path_is_free(hall, [SQUARE], dense, RADIUS)


ZONE = {"name": "wet floor", "polygon": [(8.0, 6.3), (9.0, 6.3), (9.0, 7.7), (8.0, 7.7)]}
"""All of the corridor's width."""


async def test_the_robot_neither_goes_into_a_zone_of_the_settings_nor_through_it(tmp_path: Path) -> None:
    async with serving(tmp_path, keep_out=[ZONE]) as robot, robot.mcp() as client, robot.telemetry("map") as reader:
        text = await refused(client, "navigate_to_pose", x=8.5, y=7.0)
        assert text.startswith("keep_out: The goal (8.5, 7.0) is in the keep-out zone wet floor. Choose")
        assert (await refused(client, "navigate_to_place", place="lab 2.3.9")).startswith("unreachable: ")
        assert (await call(client, "navigate_to_place", place="kitchen"))["reached"]
        shown = await reader.until(lambda m: isinstance(m, Map))
        assert [zone.name for zone in shown.zones] == ["wet floor"]
        assert set(shown.cells) <= {0, 100, 255}


async def test_with_a_zone_that_leaves_room_it_drives_around_it(tmp_path: Path) -> None:
    zone: dict[str, Any] = {"name": "cable", "polygon": [(8.0, 6.3), (8.4, 6.3), (8.4, 6.9), (8.0, 6.9)]}
    async with serving(tmp_path, keep_out=[zone]) as robot, robot.mcp() as client, robot.telemetry("path") as reader:
        assert (await call(client, "navigate_to_place", place="lab 2.3.8"))["reached"]
        path = await reader.until(lambda m: getattr(m, "points", None))
    nearest = keep_out.distances([Zone("cable", zone["polygon"])], np.array(path.points)).min()
    assert nearest >= RADIUS


def copied(tmp_path: Path, keep_out_yaml: str) -> Path:
    folder = tmp_path / "copy"
    shutil.copytree(BUILT_IN / "office", folder)
    (folder / "keep_out.yaml").write_text(keep_out_yaml)
    return folder


def test_a_world_brings_its_own_zones(office: World, tmp_path: Path) -> None:
    assert office.zones == ()
    text = "zones:\n- name: stairs\n  polygon: [[1, 2], [3, 2], [3, 4]]\n"
    world = worlds.load(str(copied(tmp_path, text)))
    assert world.zones == (Zone("stairs", [(1.0, 2.0), (3.0, 2.0), (3.0, 4.0)]),)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("zones:\n- name: stairs\n  polygon: [[1, 2], [3, 2]]\n", "zones.0.polygon"),
        ("zones:\n- name: ''\n  polygon: [[1, 2], [3, 2], [3, 4]]\n", "zones.0.name"),
        ("zones:\n- name: a\n  polygon: [[1e9, 2], [3, 2], [3, 4]]\n", "zones.0.polygon.0.0"),
        (f"zones: [{'{name: a, polygon: [[1, 2], [3, 2], [3, 4]]},' * 201}]", "at most 200 items"),
        ("zones:\n- name: a\n  polygon: [[.inf, 2], [3, 2], [3, 4]]\n", "zones.0.polygon.0.0"),
        ("zone: []\n", "zones"),
        ("zones: [", "not valid YAML"),
    ],
)
def test_a_mistake_in_the_file_is_named(tmp_path: Path, text: str, named: str) -> None:
    with pytest.raises(WorldError, match=named.replace(".", r"\.")):
        worlds.load(str(copied(tmp_path, text)))


def test_a_mistake_in_the_settings_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(config.ConfigError, match=r"robot\.keep_out\.0\.polygon"):
        config.load(robot={"keep_out": [{"name": "a", "polygon": [[1, 2]]}]})


def test_a_way_with_few_points_is_looked_at_between_them(hall: OccupancyGrid) -> None:
    with pytest.raises(Refusal, match=r"^keep_out: The way leads through the keep-out zone square"):
        safety.path_is_free(hall, [SQUARE], np.array([[2.0, 0.5], [2.0, 4.5]]), RADIUS)
    safety.path_is_free(hall, [SQUARE], np.array([[4.0, 0.5], [4.0, 4.5]]), RADIUS)
    safety.path_is_free(hall, [SQUARE], np.array([[4.0, 0.5]]), RADIUS)


@pytest.mark.parametrize("number", [math.nan, math.inf, 1e308])
def test_a_way_through_no_place_is_refused(hall: OccupancyGrid, number: float) -> None:
    with pytest.raises(Refusal, match=r"^not_finite: "):
        safety.path_is_free(hall, [SQUARE], np.array([[4.0, 0.5], [4.0, number], [4.0, 4.5]]), RADIUS)
