"""The cheapest way over a grid of cells, on two levels: coarse over the whole map, then fine along the coarse result.

Plain functions over immutable grids, safe in a thread. The coarse level leaves at least as much open as the fine one:
what is unreachable on the coarse level is unreachable.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from backend.mcp_robot.navigation.grid import Floats, OccupancyGrid

PLANNING_CELL = 0.1
"""Search at about this resolution (m): half a door's spare width, and a quarter of the cells of a usual map."""
BLOCK = 3
"""Fine cells along the side of a coarse one: two coarse ones do not reach across an inflated wall."""
COMFORT = 1.0
"""Being nearer to a wall than this (m) costs extra; half the width of a usual corridor."""
WALL_COST = 6.0
"""How many times dearer a metre along the wall is than one in the open."""

Indices = npt.NDArray[np.intp]


class Unreachable(Exception):
    """There is no way from start to goal for a robot of this size."""


@dataclass(frozen=True, eq=False)
class SearchGrid:
    """The grid that is searched: `cost[i]` per metre in flat cell i, infinite where the robot may not be.

    A border of one infinite cell lies around it, so that a neighbour's index never needs a check.
    """

    cost: Floats
    columns: int
    cell: float
    origin_x: float
    origin_y: float

    @property
    def rows(self) -> int:
        """The number of rows."""
        return self.cost.size // self.columns

    def centre(self, index: Indices) -> Floats:
        """Cells' centres in the map frame, shape (n, 2)."""
        rows, columns = np.divmod(index, self.columns)
        return np.stack([self.origin_x + (columns + 0.5) * self.cell, self.origin_y + (rows + 0.5) * self.cell], axis=1)

    @cached_property
    def coarse(self) -> SearchGrid:
        """Blocks of BLOCK x BLOCK cells, each as cheap as the cheapest of them."""
        # The border is a block wide here, so that its first cell is not the first cell's of this grid.
        rows, columns = -(-self.rows // BLOCK) + 2, -(-self.columns // BLOCK) + 2
        padded = np.full((rows * BLOCK, columns * BLOCK), np.inf)
        padded[BLOCK : BLOCK + self.rows, BLOCK : BLOCK + self.columns] = self.cost.reshape(self.rows, self.columns)
        cost = padded.reshape(rows, BLOCK, columns, BLOCK).min(axis=(1, 3)).ravel()
        size = self.cell * BLOCK
        return SearchGrid(cost, columns, size, self.origin_x - size, self.origin_y - size)

    def block(self, index: int) -> int:
        """The block of a cell."""
        row, column = divmod(index, self.columns)
        return (row // BLOCK + 1) * self.coarse.columns + column // BLOCK + 1

    def changed(self, grid: OccupancyGrid, points: Floats, radius: float) -> SearchGrid:
        """The same for a grid that differs from the one before only around these points, shape (n, 2)."""
        reach = COMFORT + grid.resolution + self.cell
        low = ((points.min(axis=0) - reach - (self.origin_x, self.origin_y)) // self.cell).astype(np.intp)
        high = ((points.max(axis=0) + reach - (self.origin_x, self.origin_y)) // self.cell).astype(np.intp)
        left, bottom = np.maximum(low, 0)
        right, top = np.minimum(high + 1, (self.columns, self.rows))
        index = (np.arange(bottom, top)[:, None] * self.columns + np.arange(left, right)).ravel()
        cost = self.cost.copy()
        cost[index] = _cost(grid, self.centre(index), self.cell, radius)
        return SearchGrid(cost, self.columns, self.cell, self.origin_x, self.origin_y)


def search_grid(grid: OccupancyGrid, radius: float) -> SearchGrid:
    """Inflate: a cell is open when a robot of `radius` fits with its centre anywhere between it and a neighbour."""
    cell = grid.resolution * max(1, round(PLANNING_CELL / grid.resolution))
    rows = int(np.ceil(grid.height * grid.resolution / cell)) + 2
    columns = int(np.ceil(grid.width * grid.resolution / cell)) + 2
    empty = SearchGrid(np.empty(0), columns, cell, grid.origin_x - cell, grid.origin_y - cell)
    cost = _cost(grid, empty.centre(np.arange(rows * columns)), cell, radius)
    cost.flags.writeable = False
    return SearchGrid(cost, columns, cell, empty.origin_x, empty.origin_y)


def _cost(grid: OccupancyGrid, centres: Floats, cell: float, radius: float) -> Floats:
    clearance = grid.clearances(centres)
    # Between two open neighbours the clearance can be smaller than at both: at worst they are half a diagonal away, at
    # a right angle to the wall's distance.
    needed = float(np.hypot(radius, cell * np.sqrt(0.5)))
    return np.where(clearance >= needed, wall_cost(clearance, radius), np.inf)


def wall_cost(clearance: Floats, radius: float) -> Floats:
    """Cost of a metre at this clearance: 1 in the open, `1 + WALL_COST` with the footprint at the wall."""
    nearness = np.clip((COMFORT - clearance) / (COMFORT - radius), 0.0, 1.0)
    result: Floats = 1.0 + WALL_COST * nearness**2
    return result


def cheapest(search: SearchGrid, start: int, goal: int) -> Indices:
    """The cells from `start` to `goal` along the cheapest way, both included. Raises `Unreachable`."""
    rough = _wavefront(search.coarse, search.block(start), search.block(goal))
    beside = np.array([r * search.coarse.columns + c for r in (-1, 0, 1) for c in (-1, 0, 1)], dtype=np.intp)
    around: Indices = np.unique(rough[:, None] + beside)
    try:
        return _a_star(_fine(search, around), search.columns, start, goal)
    except Unreachable:  # the blocks joined cells that are not joined: search the whole fine level
        return _wavefront(search, start, goal)


def _fine(search: SearchGrid, blocks: Indices) -> Mapping[int, float]:
    """Half the cost of the open cells of these blocks: a step takes half of it from either end."""
    within = np.arange(BLOCK)
    row, column = np.divmod(blocks, search.coarse.columns)
    rows = ((row - 1) * BLOCK)[:, None, None] + within[:, None]
    cols = ((column - 1) * BLOCK)[:, None, None] + within
    rows, cols = np.broadcast_arrays(rows, cols)
    inside = (rows >= 0) & (rows < search.rows) & (cols >= 0) & (cols < search.columns)
    index = rows[inside] * search.columns + cols[inside]
    index = index[np.isfinite(search.cost[index])]
    return dict(zip(index.tolist(), (0.5 * search.cost[index]).tolist(), strict=True))


def _wavefront(search: SearchGrid, start: int, goal: int) -> Indices:
    """The cheapest way by Dijkstra's algorithm in Dial's buckets, which numpy settles one at a time.

    A bucket holds the cells whose cost lies within one cell of each other, so that none of them can improve another.
    """
    cost = search.cost
    neighbours = [(r * search.columns + c, math.hypot(r, c)) for r in (-1, 0, 1) for c in (-1, 0, 1) if r or c]
    total = np.full(cost.size, np.inf)
    parent = np.full(cost.size, -1, dtype=np.intp)
    found = np.zeros(cost.size, dtype=np.bool_)
    total[goal], found[goal] = 0.0, True
    waiting: Indices = np.array([goal], dtype=np.intp)
    while waiting.size and (known := total[waiting]).min() < total[start]:
        now = known < known.min() + 1.0
        here, fronts = waiting[now], [waiting[~now]]
        so_far, leaving = total[here], 0.5 * cost[here]
        for step, length in neighbours:
            there = here + step
            candidate = so_far + length * (leaving + 0.5 * cost[there])
            better = candidate < total[there]
            there = there[better]
            total[there] = candidate[better]
            parent[there] = here[better]
            new = there[~found[there]]
            found[new] = True
            fronts.append(new)
        waiting = np.concatenate(fronts)
    if math.isinf(total[start]):
        raise Unreachable
    way = [start]
    while way[-1] != goal:
        way.append(int(parent[way[-1]]))
    return np.array(way, dtype=np.intp)


def _a_star(half: Mapping[int, float], columns: int, start: int, goal: int) -> Indices:
    """The same by A* (Hart, Nilsson and Raphael 1968), faster on few cells. `half` is half the cost of each open
    cell."""
    diagonal = math.sqrt(2.0)
    steps = [(r * columns + c, diagonal if r and c else 1.0) for r in (-1, 0, 1) for c in (-1, 0, 1) if r or c]
    goal_row, goal_column = divmod(goal, columns)
    total = {start: 0.0}
    parent = {start: start}
    done: set[int] = set()
    waiting = [(0.0, start)]
    while waiting:
        here = heapq.heappop(waiting)[1]
        if here == goal:
            break
        if here in done:
            continue
        done.add(here)
        so_far, leaving = total[here], half[here]
        for step, length in steps:
            there = here + step
            entering = half.get(there)
            if entering is None or there in done:
                continue
            candidate = so_far + length * (leaving + entering)
            if candidate < total.get(there, math.inf):
                total[there] = candidate
                parent[there] = here
                row, column = divmod(there, columns)
                dy, dx = abs(row - goal_row), abs(column - goal_column)
                to_go = dx + 0.41421 * dy if dx > dy else dy + 0.41421 * dx
                heapq.heappush(waiting, (candidate + to_go, there))
    if goal not in parent:
        raise Unreachable
    way = [goal]
    while way[-1] != start:
        way.append(parent[way[-1]])
    return np.array(way[::-1], dtype=np.intp)
