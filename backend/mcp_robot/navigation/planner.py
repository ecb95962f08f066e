"""Plans a path: the cheapest over the inflated grid, where short and far from walls is cheap, then smoothed.

Plain functions over an immutable grid, safe to run in a thread. No point of a path is nearer to anything that is not
free floor than `radius`, neither before nor after smoothing.
"""

from __future__ import annotations

import numpy as np

from backend.mcp_robot.navigation.grid import Floats, OccupancyGrid, sample
from backend.mcp_robot.navigation.search import SearchGrid, Unreachable, cheapest, search_grid, wall_cost

__all__ = ["SearchGrid", "Unreachable", "length", "plan", "resample", "search_grid"]

CORNER_ROOM = 0.12
"""A rounded corner stays so much farther (m) from walls than `radius`, where the search left that much room."""
SPACING = 0.05
"""Distance between the points of a finished path, in m."""
ATTACH = 0.6
"""How far (m) start and goal may lie from the nearest cell of the search grid."""


def plan(
    grid: OccupancyGrid,
    search: SearchGrid,
    start: tuple[float, float],
    goal: tuple[float, float],
    radius: float,
    obstacles: Floats | None = None,
) -> Floats:
    """A smooth path from `start` to `goal`, points SPACING apart, shape (n, 2). Raises `Unreachable`.

    `obstacles` are points in the way that the grid does not know, shape (n, 2).
    Start and goal themselves may be nearer to a wall than `radius`: a robot that already stands so can drive out.
    """
    if np.hypot(goal[0] - start[0], goal[1] - start[1]) < SPACING:
        return np.array([start, goal])
    if obstacles is not None and len(obstacles):
        grid = grid.with_occupied(obstacles)
        search = search.changed(grid, obstacles, radius)
    first = _attach(grid, search, start, radius)
    last = _attach(grid, search, goal, radius)
    cells = search.centre(cheapest(search, first, last))
    rough = np.concatenate([[start], cells, [goal]])
    return resample(_smooth(grid, resample(_shortcut(grid, rough, radius), SPACING), radius), SPACING)


def _attach(grid: OccupancyGrid, search: SearchGrid, point: tuple[float, float], radius: float) -> int:
    """The open cell nearest to a point that can be reached from it in a straight line."""
    reach = int(np.ceil(ATTACH / search.cell))
    column = int((point[0] - search.origin_x) // search.cell)
    row = int((point[1] - search.origin_y) // search.cell)
    rows = search.cost.size // search.columns
    r, c = np.mgrid[
        max(row - reach, 0) : min(row + reach + 1, rows),
        max(column - reach, 0) : min(column + reach + 1, search.columns),
    ]
    index = (r * search.columns + c).ravel()
    index = index[np.isfinite(search.cost[index])]
    centres = search.centre(index)
    order = np.argsort(np.hypot(centres[:, 0] - point[0], centres[:, 1] - point[1]))
    allowed = min(radius, grid.clearance(*point)) - 1e-9
    for candidate in order:
        centre = (float(centres[candidate, 0]), float(centres[candidate, 1]))
        if grid.segment_clearance(point, centre) >= allowed:
            return int(index[candidate])
    raise Unreachable


def _shortcut(grid: OccupancyGrid, points: Floats, radius: float) -> Floats:
    """Leave out points where a straight line is no dearer: the zigzag of cells goes, the distance to walls stays."""
    dear = _cumulated_cost(grid, points, radius)
    kept = [0]
    while kept[-1] < len(points) - 1:
        here = kept[-1]
        reach = here + 1
        step = 1
        ahead = here + 2
        while ahead < len(points):
            if not _no_dearer(grid, points, dear, here, ahead, radius):
                break
            reach = ahead
            step *= 2
            ahead = min(here + 1 + step, len(points) - 1) if reach < len(points) - 1 else len(points)
        kept.append(reach)
    return points[kept]


def _no_dearer(grid: OccupancyGrid, points: Floats, dear: Floats, a: int, b: int, radius: float) -> bool:
    line = sample((points[a, 0], points[a, 1]), (points[b, 0], points[b, 1]), grid.resolution / 2)
    clearance = grid.clearances(line)
    if clearance.min() < radius:
        return False
    length = float(np.hypot(*(points[b] - points[a])))
    return length * float(wall_cost(clearance, radius).mean()) <= 1.02 * float(dear[b] - dear[a])


def _cumulated_cost(grid: OccupancyGrid, points: Floats, radius: float) -> Floats:
    per_metre = wall_cost(grid.clearances(points), radius)
    lengths = np.hypot(*np.diff(points, axis=0).T)
    return np.concatenate([[0.0], np.cumsum(lengths * 0.5 * (per_metre[1:] + per_metre[:-1]))])


def _smooth(grid: OccupancyGrid, points: Floats, radius: float, rounds: int = 120) -> Floats:
    """Round the corners: each inner point moves towards the middle of its neighbours, unless that is too near a wall.

    Points are checked SPACING apart, which misses less than a millimetre between them; the ends stay. Rounding leaves
    CORNER_ROOM, because the robot that follows the path cuts the corner a little once more.
    """
    if len(points) < 3:
        return points
    smooth = points.copy()
    allowed = np.minimum(grid.clearances(points), radius + CORNER_ROOM)
    for _ in range(rounds):
        moved = smooth.copy()
        moved[1:-1] += 0.5 * (0.5 * (smooth[:-2] + smooth[2:]) - smooth[1:-1])
        free = grid.clearances(moved) >= allowed
        smooth = np.where(free[:, None], moved, smooth)
    return smooth


def resample(points: Floats, spacing: float) -> Floats:
    """The same line with points about `spacing` apart, ends included."""
    lengths = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    if along[-1] <= 0.0:
        return points[[0, -1]]
    at = np.linspace(0.0, along[-1], max(2, int(np.ceil(along[-1] / spacing)) + 1))
    return np.stack([np.interp(at, along, points[:, 0]), np.interp(at, along, points[:, 1])], axis=1)


def length(points: Floats) -> float:
    """Length of a line in m."""
    return float(np.hypot(*np.diff(points, axis=0).T).sum())
