"""A laser scanner over the occupancy grid, by sphere tracing: all around, 12 m, walls, closed doors and people.

The distance field says how far every ray can jump without missing a wall (sphere tracing, Hart 1996), so that all rays
need a few tens of array operations together instead of one lookup every few centimetres. Nothing here keeps state.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from backend.mcp_robot.navigation.grid import OCCUPIED, Floats, OccupancyGrid
from backend.telemetry import Pose

RAYS = 360
RANGE = 12.0
NOISE = 0.008
"""Standard deviation of a reading, in m, as of a usual indoor scanner."""
ANGLE_MIN = -math.pi

Disc = tuple[float, float, float]
"""A round thing in the map frame: x, y and radius in m."""


class Laser:
    """The scanner in one building. `rays` lie at ANGLE_MIN + i * `increment` in the robot's frame."""

    def __init__(self, grid: OccupancyGrid, rays: int = RAYS) -> None:
        self.rays = rays
        self.increment = math.tau / rays
        self.angles: Floats = ANGLE_MIN + self.increment * np.arange(rays, dtype=np.float64)
        self._grid = grid
        # How far a ray may jump from each cell: 0 in a wall, infinitely far in the border outside the map. No jump is
        # longer than the way to that border, so that no index needs a check.
        self._smallest = grid.resolution / 3
        jump = np.maximum(grid.distance - np.float32(grid.resolution * 1.42), np.float32(self._smallest))
        jump[grid.cells == OCCUPIED] = 0.0
        self._jump = np.pad(jump, 1, constant_values=np.inf).ravel()
        self._columns = grid.width + 2

    def scan(
        self, pose: Pose, discs: Iterable[Disc] = (), noise: np.random.Generator | None = None, *, every: int = 1
    ) -> Floats:
        """Ranges in m from a pose, of each ray or `every` nth; RANGE where nothing was hit."""
        angles = self.angles[::every] + pose.yaw
        ranges = self.cast(pose.x, pose.y, angles)
        for disc in discs:
            _shade(ranges, angles, pose, disc)
        if noise is not None:
            noisy = np.clip(ranges + noise.normal(0.0, NOISE, len(ranges)), 0.0, RANGE)
            ranges = np.where(ranges < RANGE, noisy, RANGE)
        return ranges

    def cast(self, x: float, y: float, angles: Floats, reach: float = RANGE) -> Floats:
        """The distance in m from a point in each of these directions (map frame) to the first occupied cell, `reach` at
        most.

        Exact to about a third of a cell. Unknown cells and what lies outside the map let a ray pass.
        """
        ranges = np.full(angles.shape, reach)
        if self._grid.cell(x, y) is None:
            return ranges
        scale = 1.0 / self._grid.resolution
        dx, dy = np.cos(angles) * scale, np.sin(angles) * scale
        u, v = (x - self._grid.origin_x) * scale + 1.0, (y - self._grid.origin_y) * scale + 1.0
        ray = np.arange(angles.size)
        gone = np.zeros(angles.shape)
        while ray.size:
            cell = (v + gone * dy).astype(np.intp) * self._columns + (u + gone * dx).astype(np.intp)
            jump = self._jump.take(cell)
            hit = jump == 0.0
            if hit.any():
                ranges[ray[hit]] = np.maximum(gone[hit] - self._smallest / 2, 0.0)
            gone += jump
            going = np.flatnonzero((gone < reach) & ~hit)
            if going.size < ray.size:
                ray, gone, dx, dy = ray[going], gone[going], dx[going], dy[going]
        return ranges


def _shade(ranges: Floats, angles: Floats, pose: Pose, disc: Disc) -> None:
    """Shorten the rays that meet a disc."""
    x, y, radius = disc
    distance = math.hypot(x - pose.x, y - pose.y)
    if not radius < distance < RANGE + radius:
        return
    off = angles - math.atan2(y - pose.y, x - pose.x)
    aside = distance * np.sin(off)
    meets = (np.abs(aside) < radius) & (np.cos(off) > 0)
    along = distance * np.cos(off[meets]) - np.sqrt(radius**2 - aside[meets] ** 2)
    ranges[meets] = np.minimum(ranges[meets], along)
