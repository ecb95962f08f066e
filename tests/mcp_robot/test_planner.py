"""Every place is reached from every other, in the middle of the way, and no path touches anything."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from backend.mcp_robot.grid import FREE, OCCUPIED, OccupancyGrid
from backend.mcp_robot.simulator import planner
from backend.mcp_robot.simulator.world import World

RADIUS = 0.3


@pytest.fixture(scope="module")
def search(office: World) -> planner.SearchGrid:
    return planner.search_grid(office.grid, RADIUS)


def tightest(grid: OccupancyGrid, path: np.ndarray) -> float:
    """The smallest clearance along a path, looked at every centimetre."""
    return float(grid.clearances(planner.resample(path, 0.01)).min())


def test_every_place_is_reached_from_every_other_without_touching_anything(
    office: World, search: planner.SearchGrid
) -> None:
    places = {place.name: (place.pose.x, place.pose.y) for place in office.places.places}
    for start, goal in itertools.combinations(places, 2):
        path = planner.plan(office.grid, search, places[start], places[goal], RADIUS)
        assert tuple(path[0]) == pytest.approx(places[start])
        assert tuple(path[-1]) == pytest.approx(places[goal])
        assert tightest(office.grid, path) >= RADIUS, f"{start} to {goal}"


def test_from_the_dock_to_lab_237_it_is_between_11_and_16_metres(office: World, search: planner.SearchGrid) -> None:
    places = {place.name: (place.pose.x, place.pose.y) for place in office.places.places}
    path = planner.plan(office.grid, search, places["dock"], places["lab 2.3.7"], RADIUS)
    assert 11.0 <= planner.length(path) <= 16.0


def test_a_path_keeps_to_the_middle_of_the_corridor(office: World, search: planner.SearchGrid) -> None:
    path = planner.plan(office.grid, search, (6.5, 6.5), (13.0, 7.5), RADIUS)
    middle = path[(path[:, 0] > 8.5) & (path[:, 0] < 11.0)]
    assert np.abs(middle[:, 1] - 7.0).max() < 0.35


@pytest.mark.parametrize("seed", range(6))
def test_random_goals_are_reached_safely_or_refused(office: World, search: planner.SearchGrid, seed: int) -> None:
    generator = np.random.default_rng(seed)
    points = generator.uniform((0, 0), (24, 14), size=(400, 2))
    free = points[office.grid.clearances(points) >= RADIUS][:12]
    found = 0
    for start, goal in itertools.pairwise(map(tuple, free)):
        try:
            path = planner.plan(office.grid, search, start, goal, RADIUS)
        except planner.Unreachable:
            continue
        found += 1
        assert tightest(office.grid, path) >= RADIUS - 0.005
    assert found >= 8  # a few pockets between furniture and wall cannot be left by a robot of this size


def test_a_goal_behind_a_wall_is_unreachable() -> None:
    cells = np.full((60, 60), FREE, dtype=np.uint8)
    cells[:, 30] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1, 0.0, 0.0)
    with pytest.raises(planner.Unreachable):
        planner.plan(grid, planner.search_grid(grid, RADIUS), (1.0, 3.0), (5.0, 3.0), RADIUS)


def test_a_gap_that_is_too_narrow_is_no_way_and_one_that_is_wide_enough_is() -> None:
    for gap, passable in ((5, False), (9, True)):
        cells = np.full((80, 80), FREE, dtype=np.uint8)
        cells[:, 40] = OCCUPIED
        cells[40 : 40 + gap, 40] = FREE
        grid = OccupancyGrid(cells, 0.1, 0.0, 0.0)
        search = planner.search_grid(grid, RADIUS)
        if passable:
            path = planner.plan(grid, search, (1.0, 1.0), (7.0, 1.0), RADIUS)
            assert tightest(grid, path) >= RADIUS
        else:
            with pytest.raises(planner.Unreachable):
                planner.plan(grid, search, (1.0, 1.0), (7.0, 1.0), RADIUS)
