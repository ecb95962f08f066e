"""The occupancy grid: which cells are free, occupied or unknown, and how far a point is from the next wall.

Row 0 of every array is at the bottom (smallest y), so that an index grows with its coordinate. Immutable once made:
planner, laser and safety rules read it from several threads.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
import numpy.typing as npt

FREE = 0
OCCUPIED = 100
KEEP_OUT = 254
"""Free floor inside a keep-out zone: nothing stands there, and the robot must not."""
UNKNOWN = 255

CLEARANCE_CAP = 3.0
"""Distances are exact up to so many metres, and never reported larger."""

MAX_CELLS = 64_000_000
FINEST, COARSEST = 0.005, 5.0
"""Metres a cell. Distances are found by trying all cells around: of finer ones that would take minutes."""
FARTHEST = 1e6
"""Metres from the map frame's origin beyond which nothing can be."""

Floats = npt.NDArray[np.float64]
Floats32 = npt.NDArray[np.float32]
Real = TypeVar("Real", np.float32, np.float64)


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """`cells[row, column]` is FREE, OCCUPIED, UNKNOWN or KEEP_OUT; `resolution` in m a cell; the lower left corner of
    cell (0, 0) lies at (`origin_x`, `origin_y`) in the map frame, in m."""

    cells: npt.NDArray[np.uint8]
    resolution: float
    origin_x: float
    origin_y: float

    @property
    def height(self) -> int:
        """Rows."""
        return int(self.cells.shape[0])

    @property
    def width(self) -> int:
        """Columns."""
        return int(self.cells.shape[1])

    @property
    def extent(self) -> str:
        """The map's sides in the map frame, for people."""
        x0, y0 = self.origin_x, self.origin_y
        x1, y1 = x0 + self.width * self.resolution, y0 + self.height * self.resolution
        return f"x from {x0:.1f} to {x1:.1f}, y from {y0:.1f} to {y1:.1f}"

    def cell(self, x: float, y: float) -> tuple[int, int] | None:
        """Row and column of the cell that holds the point, None outside the map."""
        column = (x - self.origin_x) // self.resolution
        row = (y - self.origin_y) // self.resolution
        if 0 <= row < self.height and 0 <= column < self.width:  # before `int`, which infinity and NaN do not have
            return int(row), int(column)
        return None

    def state(self, x: float, y: float) -> int | None:
        """FREE, OCCUPIED, UNKNOWN or KEEP_OUT; None outside the map."""
        cell = self.cell(x, y)
        return None if cell is None else int(self.cells[cell])

    @cached_property
    def distance(self) -> npt.NDArray[np.float32]:
        """Metres from each cell's centre to the nearest centre of a cell that is not free, up to CLEARANCE_CAP.

        What lies outside the map counts as not free.
        """
        return distance_field(self.cells != FREE, self.resolution, CLEARANCE_CAP)

    def clearance(self, x: float, y: float) -> float:
        """Metres of free space around a point, never too large: 0 or less in a wall or outside the map."""
        u = (x - self.origin_x) / self.resolution - 0.5
        v = (y - self.origin_y) / self.resolution - 0.5
        if not (0 <= u < self.width - 1 and 0 <= v < self.height - 1):
            return 0.0
        column, row = int(u), int(v)
        a, b = u - column, v - row
        item = self.distance.item
        low = item(row, column) * (1 - a) + item(row, column + 1) * a
        high = item(row + 1, column) * (1 - a) + item(row + 1, column + 1) * a
        return float(low * (1 - b) + high * b) - self._half_diagonal

    def clearances(self, points: npt.NDArray[Real]) -> npt.NDArray[Real]:
        """`clearance` of many points, shape (n, 2) -> (n,), in the precision of the points."""
        u = (points[:, 0] - self.origin_x) / self.resolution - 0.5
        v = (points[:, 1] - self.origin_y) / self.resolution - 0.5
        column = np.floor(u).astype(np.intp)
        row = np.floor(v).astype(np.intp)
        inside = (column >= 0) & (column < self.width - 1) & (row >= 0) & (row < self.height - 1)
        column = np.clip(column, 0, self.width - 2)
        row = np.clip(row, 0, self.height - 2)
        a, b = u - column, v - row
        d = self.distance
        low = d[row, column] * (1 - a) + d[row, column + 1] * a
        high = d[row + 1, column] * (1 - a) + d[row + 1, column + 1] * a
        result: npt.NDArray[Real] = np.where(inside, low * (1 - b) + high * b - self._half_diagonal, 0.0)
        return result

    def with_occupied(self, points: Floats) -> OccupancyGrid:
        """The same grid with the cells of these points, shape (n, 2), occupied; those outside the map are left out.

        Its distance field is the minimum of this one's and the distances to the new cells: exact, and much cheaper than
        to compute it anew.
        """
        column = ((points[:, 0] - self.origin_x) // self.resolution).astype(np.intp)
        row = ((points[:, 1] - self.origin_y) // self.resolution).astype(np.intp)
        inside = (column >= 0) & (column < self.width) & (row >= 0) & (row < self.height)
        flat = np.unique(row[inside] * self.width + column[inside])
        cells, distance = self.cells.copy(), self.distance.copy()
        cells.ravel()[flat] = OCCUPIED
        reach = int(np.ceil(CLEARANCE_CAP / self.resolution))
        offsets = np.arange(-reach, reach + 1, dtype=np.float32) * np.float32(self.resolution)
        around = np.hypot(offsets[:, None], offsets)
        for r, c in zip(*np.divmod(flat, self.width), strict=True):
            top, left = max(r - reach, 0), max(c - reach, 0)
            window = distance[top : r + reach + 1, left : c + reach + 1]
            stamp = around[top - r + reach :, left - c + reach :][: window.shape[0], : window.shape[1]]
            np.minimum(window, stamp, out=window)
        cells.flags.writeable = False
        grid = OccupancyGrid(cells, self.resolution, self.origin_x, self.origin_y)
        grid.__dict__["distance"] = distance  # what the cached property would compute
        return grid

    @property
    def _half_diagonal(self) -> float:
        # A cell is a square around its centre: its corner is the nearest that the wall can be.
        return self.resolution * float(np.sqrt(0.5))

    def segment_clearance(self, start: tuple[float, float], end: tuple[float, float]) -> float:
        """The smallest clearance along a straight line, sampled every half cell, in m."""
        return float(self.clearances(sample(start, end, self.resolution / 2)).min())


def sample(start: tuple[float, float], end: tuple[float, float], step: float) -> Floats:
    """Points from `start` to `end`, both included, at most `step` m apart; shape (n, 2)."""
    length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
    count = max(2, int(np.ceil(length / step)) + 1)
    return np.linspace(start, end, count)


def distance_field(blocked: npt.NDArray[np.bool_], resolution: float, cap: float) -> npt.NDArray[np.float32]:
    """Euclidean distance in m from each cell to the nearest blocked one, exact up to `cap`.

    Two passes, as in Felzenszwalb and Huttenlocher 2012: along columns by running maxima, then across rows by
    trying every offset up to the cap, which numpy does faster than their lower envelope at these sizes.
    """
    reach = int(np.ceil(cap / resolution))
    padded = np.pad(blocked, 1, constant_values=True)
    rows = np.arange(padded.shape[0], dtype=np.float32)[:, None]
    below = np.maximum.accumulate(np.where(padded, rows, np.float32(-1e6)), axis=0)
    above = np.minimum.accumulate(np.where(padded, rows, np.float32(1e6))[::-1], axis=0)[::-1]
    vertical = np.minimum(rows - below, above - rows)
    squared = np.minimum(vertical, np.float32(reach)) ** 2
    best = squared.copy()
    for offset in range(1, min(reach, padded.shape[1] - 1) + 1):
        cost = np.float32(offset * offset)
        np.minimum(best[:, offset:], squared[:, :-offset] + cost, out=best[:, offset:])
        np.minimum(best[:, :-offset], squared[:, offset:] + cost, out=best[:, :-offset])
    field = np.minimum(np.sqrt(best[1:-1, 1:-1]) * np.float32(resolution), np.float32(cap))
    return np.ascontiguousarray(field, dtype=np.float32)
