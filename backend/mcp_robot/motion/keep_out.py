"""Keep-out zones: polygons of the map that the robot's footprint must not touch, whoever asks.

Plain geometry on `telemetry.Zone`, in the map frame. Distances are exact; the grid that the planner searches marks
whole cells, so that a zone is never smaller there than its polygon. safety.py and guard.py decide what follows from a
distance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from backend.mcp_robot.navigation.grid import FREE, KEEP_OUT, Floats, OccupancyGrid, sample
from backend.telemetry import Zone

Points = Floats
Point = tuple[float, float]


def distances(zones: Sequence[Zone], points: Points) -> Floats:
    """Metres from each point, shape (n, 2), to the nearest zone: negative inside one, infinite without zones."""
    nearest = np.full(len(points), np.inf)
    for zone in zones:
        np.minimum(nearest, _distance(zone, points), out=nearest)
    return nearest


def nearest(zones: Sequence[Zone], x: float, y: float) -> tuple[float, Zone] | None:
    """The zone that is nearest to a point and its distance in m, negative inside; None without zones."""
    point = np.array([[x, y]])
    found = [(float(_distance(zone, point)[0]), index) for index, zone in enumerate(zones)]
    if not found:
        return None
    distance, index = min(found)
    return distance, zones[index]


def applied(grid: OccupancyGrid, zones: Sequence[Zone]) -> OccupancyGrid:
    """The grid with every free cell that a zone touches marked KEEP_OUT; the same one when there is none."""
    if not zones:
        return grid
    cells = grid.cells.copy()
    for zone in zones:
        cells[_touched(grid, zone) & (cells == FREE)] = KEEP_OUT
    cells.flags.writeable = False
    return OccupancyGrid(cells, grid.resolution, grid.origin_x, grid.origin_y)


def _distance(zone: Zone, points: Points) -> Floats:
    corners = np.asarray(zone.polygon, dtype=np.float64)
    starts, sides = corners, np.roll(corners, -1, axis=0) - corners
    squared = np.maximum(np.einsum("ij,ij->i", sides, sides), 1e-18)
    offsets = points[:, None, :] - starts[None, :, :]  # (point, side, 2)
    along = np.clip(np.einsum("ijk,jk->ij", offsets, sides) / squared, 0.0, 1.0)
    gaps = offsets - along[:, :, None] * sides
    distance = np.sqrt(np.einsum("ijk,ijk->ij", gaps, gaps).min(axis=1))
    result: Floats = np.where(_inside(corners, points), -distance, distance)
    return result


def _inside(corners: Points, points: Points) -> npt.NDArray[np.bool_]:
    """Even-odd: a ray to the right crosses an odd number of sides."""
    x, y = points[:, 0], points[:, 1]
    inside = np.zeros(len(points), dtype=np.bool_)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if ay == by:
            continue
        crosses = (ay > y) != (by > y)
        inside ^= crosses & (x < ax + (y - ay) / (by - ay) * (bx - ax))
    return inside


def _touched(grid: OccupancyGrid, zone: Zone) -> npt.NDArray[np.bool_]:
    """Cells whose centre lies inside, and those that a side runs through."""
    corners = np.asarray(zone.polygon, dtype=np.float64)
    touched = np.zeros(grid.cells.shape, dtype=np.bool_)
    origin = np.array([grid.origin_x, grid.origin_y])
    size = np.array([grid.width, grid.height])
    low = np.clip(np.floor((corners.min(axis=0) - origin) / grid.resolution), 0, size).astype(int)
    high = np.clip(np.floor((corners.max(axis=0) - origin) / grid.resolution) + 1, 0, size).astype(int)
    if (low >= high).any():
        return touched
    columns, rows = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    centres = origin + (np.stack([columns.ravel(), rows.ravel()], axis=1) + 0.5) * grid.resolution
    touched[low[1] : high[1], low[0] : high[0]] = _inside(corners, centres).reshape(rows.shape)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        on_map = _on_map(grid, start, end)
        if on_map is None:
            continue
        line = sample(*on_map, grid.resolution / 4)
        column, row = np.floor((line - origin) / grid.resolution).astype(np.intp).T
        inside = (column >= 0) & (column < grid.width) & (row >= 0) & (row < grid.height)
        touched[row[inside], column[inside]] = True
    return touched


def _on_map(grid: OccupancyGrid, start: Points, end: Points) -> tuple[Point, Point] | None:
    """The part of a side that lies on the map or beside it, so that no side has more points than the map has cells;
    None for a side that lies off the map (Liang and Barsky 1984)."""
    low = np.array([grid.origin_x, grid.origin_y]) - grid.resolution
    high = low + np.array([grid.width + 2, grid.height + 2]) * grid.resolution
    first, last = 0.0, 1.0
    for begin, way, least, most in zip(start, end - start, low, high, strict=True):
        if way == 0.0:
            if not least <= begin <= most:
                return None
            continue
        crossings = sorted(((least - begin) / way, (most - begin) / way))
        first, last = max(first, crossings[0]), min(last, crossings[1])
    if first > last:
        return None
    (x0, y0), (x1, y1) = start + first * (end - start), start + last * (end - start)
    return (float(x0), float(y0)), (float(x1), float(y1))
