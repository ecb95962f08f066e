"""Every place is reached from every other, in the middle of the way, and no path touches anything."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from backend.mcp_robot.navigation import planner
from backend.mcp_robot.navigation import search as searching
from backend.mcp_robot.navigation.grid import FREE, OCCUPIED, OccupancyGrid
from backend.mcp_robot.simulator import world
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


@pytest.fixture(scope="module")
def hospital() -> World:
    return world.load("hospital")


@pytest.mark.parametrize("seed", range(3))
def test_across_the_large_world_paths_touch_nothing_and_are_about_as_cheap_as_can_be(
    hospital: World, seed: int
) -> None:
    generator = np.random.default_rng(seed)
    grid = hospital.grid
    fine = planner.search_grid(grid, RADIUS)
    points = generator.uniform((0, 0), (100, 60), size=(200, 2))
    free = points[grid.clearances(points) >= RADIUS + 0.1][:8]
    for start, goal in itertools.pairwise(map(tuple, free)):
        path = planner.plan(grid, fine, start, goal, RADIUS)
        assert tightest(grid, path) >= RADIUS - 0.005
        ends = [planner._attach(grid, fine, end, RADIUS) for end in (start, goal)]
        best = searching._wavefront(fine, *ends)  # one level, everywhere
        assert cells_cost(fine, searching.cheapest(fine, *ends)) <= 1.05 * cells_cost(fine, best)


def cells_cost(search: planner.SearchGrid, cells: np.ndarray) -> float:
    lengths = np.hypot(*np.diff(search.centre(cells), axis=0).T)
    return float((lengths * 0.5 * (search.cost[cells][1:] + search.cost[cells][:-1])).sum())


def test_where_the_coarse_level_promises_too_much_the_whole_map_is_searched() -> None:
    # A wall that is one open cell thick on the coarse level, with its only gap far away.
    cells = np.full((120, 120), FREE, dtype=np.uint8)
    cells[:110, 60] = OCCUPIED
    grid = OccupancyGrid(cells, 0.1, 0.0, 0.0)
    fine = planner.search_grid(grid, 0.01)
    assert np.isfinite(fine.coarse.cost).sum() > 0
    path = planner.plan(grid, fine, (5.0, 1.0), (7.0, 1.0), 0.01)
    assert path[:, 1].max() > 11.0


def test_obstacles_that_the_map_does_not_know_are_gone_round_or_close_the_way(
    office: World, search: planner.SearchGrid
) -> None:
    start, goal = (6.5, 7.0), (13.0, 7.0)
    obstacle = np.array([[10.0, 7.0], [10.1, 7.0]])
    path = planner.plan(office.grid, search, start, goal, RADIUS, obstacle)
    assert min(float(np.hypot(*(path - point).T).min()) for point in obstacle) >= RADIUS
    across = np.stack([np.full(21, 10.0), np.linspace(6.0, 8.0, 21)], axis=1)
    with pytest.raises(planner.Unreachable):
        planner.plan(office.grid, search, start, goal, RADIUS, across)


def test_a_search_grid_that_is_changed_is_the_one_that_is_made_anew(office: World, search: planner.SearchGrid) -> None:
    points = np.array([[10.0, 7.0], [3.0, 3.0], [23.9, 13.9]])
    grid = office.grid.with_occupied(points)
    changed, anew = search.changed(grid, points, RADIUS), planner.search_grid(grid, RADIUS)
    assert np.array_equal(np.isfinite(changed.cost), np.isfinite(anew.cost))
    assert np.allclose(changed.cost[np.isfinite(anew.cost)], anew.cost[np.isfinite(anew.cost)])
