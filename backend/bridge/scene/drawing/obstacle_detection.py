"""Obstacles that the laser sees and the map does not explain: people, chairs, closed doors.

An obstacle says that something stands there, not what. It is only drawn: what stops the robot is the robot server's
business. Plain functions and data, without viser and without a clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from backend import telemetry

WALL_TOLERANCE = 0.25
"""m around an occupied cell within which a reading belongs to that wall."""
MAX_RANGE = 8.0
"""m beyond which readings are too far apart, and a small error of the heading moves walls too much."""
MAX_GAP = 0.35
"""m between two neighbouring readings of one obstacle."""
MAX_WIDTH = 0.8
"""m that one obstacle is wide at most; a wider thing is several obstacles."""
MIN_READINGS = 2
"""A single reading is noise."""
MAX_OBSTACLES = 24
"""At once; the nearest ones count."""
_MIN_RADIUS, _MAX_RADIUS = 0.12, 0.45
"""m"""
_SAME_DISTANCE = 0.6
"""m within which an obstacle of the next scan is the same one."""
_STILL_DISTANCE = 0.04
"""m that an obstacle has to move before it is moved in the scene."""
_KEPT_SECONDS = 0.4
"""s that an obstacle stays after it was seen last."""

Points = npt.NDArray[np.floating[Any]]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Obstacle:
    """An upright cylinder at `x`, `y` of the map frame, `radius` in m."""

    x: float
    y: float
    radius: float


class ExplainedMap:
    """The cells of a map in which a reading cannot be a wall: those that are free and not near a wall."""

    def __init__(self, grid: telemetry.Map) -> None:
        cells = np.frombuffer(grid.cells, np.uint8).reshape(grid.height, grid.width)
        near_wall = dilate(cells == 100, math.ceil(WALL_TOLERANCE / grid.resolution))
        self._open = ~near_wall & (cells != 255)  # in an unknown cell the map explains nothing
        self._resolution = grid.resolution
        self._origin = np.array([grid.origin_x, grid.origin_y])

    def unexplained(self, points: Points) -> Mask:
        """Which of the points (N, 2) of the map frame belong to no wall."""
        cells = np.floor((points - self._origin) / self._resolution).astype(np.int64)
        rows, columns = cells[:, 1], cells[:, 0]
        on_map = (rows >= 0) & (columns >= 0) & (rows < self._open.shape[0]) & (columns < self._open.shape[1])
        unexplained = np.zeros(len(points), np.bool_)
        unexplained[on_map] = self._open[rows[on_map], columns[on_map]]
        return unexplained


def dilate(mask: Mask, radius: int) -> Mask:
    """The cells within `radius` cells of a true one: a morphological dilation with a disc."""
    widened = [mask]  # by 0, 1, 2 … cells to both sides
    for by in range(1, radius + 1):
        wider = widened[-1].copy()
        wider[:, by:] |= mask[:, :-by]
        wider[:, :-by] |= mask[:, by:]
        widened.append(wider)
    dilated = widened[radius].copy()
    for up in range(1, radius + 1):
        row = widened[math.isqrt(radius * radius - up * up)]
        dilated[up:] |= row[:-up]
        dilated[:-up] |= row[up:]
    return dilated


def detect(hits: Points, robot: telemetry.Pose, explained: ExplainedMap) -> list[Obstacle]:
    """The obstacles of one scan, the nearest first; `hits` are its points (N, 2) of the map frame in their order."""
    here = np.array([robot.x, robot.y])
    in_range = hits[np.hypot(*(hits - here).T) < MAX_RANGE]
    points = in_range[explained.unexplained(in_range)]
    obstacles = [_obstacle(cluster, here) for cluster in _clusters(points) if len(cluster) >= MIN_READINGS]
    obstacles.sort(key=lambda obstacle: math.dist((obstacle.x, obstacle.y), (robot.x, robot.y)))
    return obstacles[:MAX_OBSTACLES]


def _clusters(points: Points) -> list[Points]:
    """Neighbouring readings that belong together, in the order of the scan."""
    clusters: list[list[Points]] = []
    for point in points:
        last = clusters[-1] if clusters else None
        if last is not None and math.dist(last[-1], point) < MAX_GAP and math.dist(last[0], point) < MAX_WIDTH:
            last.append(point)
        else:
            clusters.append([point])
    if len(clusters) > 1:  # a scan goes all around: its end may belong to its beginning
        first, last = clusters[0], clusters[-1]
        if math.dist(last[-1], first[0]) < MAX_GAP and math.dist(last[0], first[-1]) < MAX_WIDTH:
            clusters[0] = clusters.pop() + first
    return [np.array(cluster) for cluster in clusters]


def _obstacle(cluster: Points, robot: Points) -> Obstacle:
    """The laser sees only the near side, so the obstacle's centre is assumed half a radius behind the readings."""
    middle = cluster.mean(axis=0)
    radius = min(max(math.dist(cluster[0], cluster[-1]) / 2 + 0.03, _MIN_RADIUS), _MAX_RADIUS)
    away = middle - robot
    length = float(np.linalg.norm(away)) or 1.0
    x, y = middle + away / length * radius / 2
    return Obstacle(float(x), float(y), radius)


class ObstacleTracker:
    """Keeps each obstacle in one of a fixed number of slots while it moves. `slots[i]` is None where a slot is free."""

    def __init__(self) -> None:
        self.slots: list[Obstacle | None] = [None] * MAX_OBSTACLES
        self._last_seen = [-math.inf] * MAX_OBSTACLES  # s, of each slot

    def update(self, obstacles: Sequence[Obstacle], now: float) -> None:
        """Put each obstacle of a scan into the slot of the same one before; free the slots of those not seen lately."""
        free = {i for i, obstacle in enumerate(self.slots) if obstacle is None}
        slot_of = self._matches(obstacles)
        matched = set(slot_of.values())
        for i, old in enumerate(self.slots):
            if old is not None and i not in matched and now - self._last_seen[i] > _KEPT_SECONDS:
                self.slots[i] = None
                free.add(i)
        for j, new in enumerate(obstacles):
            i = slot_of.get(j, -1)
            if i < 0:
                if not free:
                    continue
                i = min(free)
                free.remove(i)
            self._last_seen[i] = now
            self.slots[i] = _without_jitter(self.slots[i], new)

    def clear(self) -> None:
        """Free all slots."""
        self.slots = [None] * MAX_OBSTACLES

    def _matches(self, obstacles: Sequence[Obstacle]) -> dict[int, int]:
        """The slot of each obstacle (by its index) that was there before; the nearest pairs first."""
        pairs = sorted(
            (math.dist((new.x, new.y), (old.x, old.y)), j, i)
            for j, new in enumerate(obstacles)
            for i, old in enumerate(self.slots)
            if old is not None
        )
        slot_of: dict[int, int] = {}
        taken: set[int] = set()
        for distance, j, i in pairs:
            if distance < _SAME_DISTANCE and j not in slot_of and i not in taken:
                slot_of[j] = i
                taken.add(i)
        return slot_of


def _without_jitter(old: Obstacle | None, new: Obstacle) -> Obstacle:
    """`old` unless it has really moved: no two scans are equal, and each change of the scene costs."""
    if old is None or math.dist((old.x, old.y), (new.x, new.y)) > _STILL_DISTANCE:
        return new
    return new if abs(old.radius - new.radius) > 2 * _STILL_DISTANCE else old
