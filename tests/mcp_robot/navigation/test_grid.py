"""Distances to walls are right, and where they cannot be exact they err to the safe side."""

from __future__ import annotations

import math

import numpy as np
import pytest

from backend.mcp_robot.navigation.grid import FREE, OCCUPIED, OccupancyGrid, distance_field


def test_the_distance_field_is_the_euclidean_distance_up_to_its_cap() -> None:
    generator = np.random.default_rng(7)
    blocked = generator.random((40, 55)) < 0.02
    field = distance_field(blocked, 0.1, 1.5)
    around = np.pad(blocked, 1, constant_values=True)
    rows, columns = np.nonzero(around)
    for row, column in generator.integers((40, 55), size=(200, 2)):
        exact = 0.1 * np.hypot(rows - 1 - row, columns - 1 - column).min()
        assert field[row, column] == pytest.approx(min(exact, 1.5), abs=1e-5)


def test_clearance_never_promises_more_than_there_is() -> None:
    generator = np.random.default_rng(3)
    cells = np.where(generator.random((60, 60)) < 0.01, OCCUPIED, FREE).astype(np.uint8)
    grid = OccupancyGrid(cells, 0.05, -1.0, 2.0)
    points = generator.uniform((-1.0, 2.0), (2.0, 5.0), size=(500, 2))
    many = grid.clearances(points)
    for (x, y), clearance in zip(points, many, strict=True):
        assert grid.clearance(x, y) == pytest.approx(clearance, abs=1e-6)
        exact = true_distance(grid, x, y)
        if exact > 0.2:  # nearer than any footprint, interpolation between cells is coarser
            assert exact - 0.08 <= min(clearance, exact) <= exact
            assert clearance <= exact + 0.002


def true_distance(grid: OccupancyGrid, x: float, y: float) -> float:
    """To the nearest square of a cell that is not free, or to the border, by geometry."""
    rows, columns = np.nonzero(grid.cells != FREE)
    left = grid.origin_x + columns * grid.resolution
    bottom = grid.origin_y + rows * grid.resolution
    dx = np.maximum(np.maximum(left - x, x - left - grid.resolution), 0)
    dy = np.maximum(np.maximum(bottom - y, y - bottom - grid.resolution), 0)
    border = min(
        x - grid.origin_x,
        y - grid.origin_y,
        grid.origin_x + grid.width * grid.resolution - x,
        grid.origin_y + grid.height * grid.resolution - y,
    )
    return min(float(np.hypot(dx, dy).min()), max(border, 0.0)) if len(rows) else math.inf
