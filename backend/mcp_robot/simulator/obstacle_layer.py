"""The obstacle layer: what the laser sees and the map does not show, as in a costmap.

Plain state, time passed in. Points are placed from the pose that the robot believes, as all that a robot knows; nothing
here reads the true world. A point is removed when a ray passes through it, or after a while in which it was not seen.
"""

from __future__ import annotations

import math

import numpy as np

from backend.mcp_robot.navigation.grid import Floats, OccupancyGrid
from backend.telemetry import Pose

CELL = 0.1
"""Points nearer to each other than about this (m) are one."""
SIGHT = 5.0
"""Readings farther away (m) are ignored: the thing may be gone when the robot comes."""
EXPLAINED = 0.15
"""A reading so near (m) to a wall of the map is that wall, not something new; localisation errors add to it."""
MEMORY = 60.0
"""Seconds after which an obstacle that was not seen again is forgotten."""


class ObstacleLayer:
    """Points in the map frame. `tolerance` is the error in m that the believed pose can add to a reading."""

    def __init__(self, grid: OccupancyGrid, tolerance: float = 0.0) -> None:
        self._grid = grid
        self._explained = EXPLAINED + tolerance
        self._slack = CELL + tolerance
        self._seen: dict[tuple[int, int], float] = {}  # cell -> when it was seen last
        self.points: Floats = np.empty((0, 2))  # the cells' centres, replaced by `take`

    def take(self, now: float, pose: Pose, angles: Floats, ranges: Floats) -> None:
        """Take in a scan: `angles` in the robot's frame, evenly spaced from -pi on; `pose` as believed."""
        self._forget(now, pose, ranges)
        near = np.flatnonzero(ranges < SIGHT)
        bearing = angles[near] + pose.yaw
        x, y = pose.x + ranges[near] * np.cos(bearing), pose.y + ranges[near] * np.sin(bearing)
        for i in np.flatnonzero(self._new(x, y)).tolist():
            self._seen[math.floor(x[i] / CELL), math.floor(y[i] / CELL)] = now
        self.points = (np.array(list(self._seen), dtype=np.float64).reshape(-1, 2) + 0.5) * CELL

    def _new(self, x: Floats, y: Floats) -> np.typing.NDArray[np.bool_]:
        grid = self._grid
        column = np.floor((x - grid.origin_x) / grid.resolution).astype(np.intp)
        row = np.floor((y - grid.origin_y) / grid.resolution).astype(np.intp)
        inside = (column >= 0) & (column < grid.width) & (row >= 0) & (row < grid.height)
        column, row = np.where(inside, column, 0), np.where(inside, row, 0)
        result: np.typing.NDArray[np.bool_] = inside & (grid.distance[row, column] > self._explained)
        return result

    def _forget(self, now: float, pose: Pose, ranges: Floats) -> None:
        if not self._seen:
            return
        dx, dy = self.points[:, 0] - pose.x, self.points[:, 1] - pose.y
        ray = np.rint((np.arctan2(dy, dx) - pose.yaw + math.pi) / math.tau * len(ranges)).astype(np.intp)
        passed = ranges[ray % len(ranges)] > np.hypot(dx, dy) + self._slack
        for cell, gone in zip(list(self._seen), passed.tolist(), strict=True):
            if gone or now - self._seen[cell] > MEMORY:
                del self._seen[cell]

    def obstruct(self, line: Floats, radius: float) -> bool:
        """Whether an obstacle lies within `radius` m of a line's points, shape (n, 2)."""
        if not len(self.points) or not len(line):
            return False
        apart = self.points[:, None, :] - line[None, :, :]
        return bool((np.einsum("ijk,ijk->ij", apart, apart) < radius**2).any())
