"""A laser scanner over the occupancy grid: 360 rays, 12 m, by sphere tracing.

Plain functions. The distance field says how far every ray can jump without missing a wall, so that all rays need a few
tens of array operations together instead of one lookup every few centimetres.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from backend.mcp_robot.grid import OCCUPIED, Floats, OccupancyGrid
from backend.telemetry import Pose

RAYS = 360
RANGE = 12.0
NOISE = 0.008
"""Standard deviation of a reading, in m, as of a usual indoor scanner."""

ANGLE_MIN = -math.pi
ANGLE_INCREMENT = math.tau / RAYS
_ANGLES: Floats = np.linspace(ANGLE_MIN, math.pi, RAYS, endpoint=False, dtype=np.float64)


def scan(grid: OccupancyGrid, pose: Pose, noise: np.random.Generator | None = None) -> Floats:
    """Ranges in m at ANGLE_MIN + i * ANGLE_INCREMENT in the robot's frame; RANGE where nothing was hit."""
    ranges = cast_rays(grid, pose.x, pose.y, _ANGLES + pose.yaw, RANGE)
    if noise is not None:
        hit = ranges < RANGE
        ranges = np.where(hit, np.clip(ranges + noise.normal(0.0, NOISE, RAYS), 0.0, RANGE), ranges)
    return ranges


def cast_rays(grid: OccupancyGrid, x: float, y: float, angles: Floats, reach: float) -> Floats:
    """How far rays from a point in these directions (map frame) go until they meet an occupied cell.

    Exact to about a third of a cell. Unknown cells and what lies outside the map let a ray pass.
    """
    inverse = 1.0 / grid.resolution
    dx, dy = np.cos(angles) * inverse, np.sin(angles) * inverse
    u, v = (x - grid.origin_x) * inverse, (y - grid.origin_y) * inverse
    ranges = np.full(angles.shape, reach)
    travelled = np.zeros(angles.shape)
    active: npt.NDArray[np.intp] = np.arange(angles.size)
    smallest = grid.resolution / 3
    while active.size:
        column = np.floor(u + travelled[active] * dx[active]).astype(np.intp)
        row = np.floor(v + travelled[active] * dy[active]).astype(np.intp)
        inside = (column >= 0) & (column < grid.width) & (row >= 0) & (row < grid.height)
        column[~inside] = row[~inside] = 0
        hit = inside & (grid.cells[row, column] == OCCUPIED)
        ranges[active[hit]] = np.maximum(travelled[active[hit]] - smallest / 2, 0.0)
        jump = np.maximum(grid.distance[row, column] - grid.resolution * 1.42, smallest)
        travelled[active] += np.where(inside, jump, smallest)
        going = ~hit & (travelled[active] < reach) & inside
        active = active[going]
    result: Floats = np.minimum(ranges, reach)
    return result
