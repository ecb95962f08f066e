"""What the laser sees and the map does not explain: people, chairs, closed doors, as upright posts.

A post says that something stands there, not what. Plain functions and data, without viser and without a clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from backend import telemetry

EXPLAINED = 0.25
"""m around an occupied cell within which a reading is that wall."""
REACH = 8.0
"""m beyond which readings are too far apart, and a wrong heading moves walls too much."""
GAP = 0.35
"""m between two neighbouring readings that no longer belong together."""
WIDEST = 0.8
"""m that one post stands for; what is wider gets several."""
FEWEST = 2
"""Readings that make a post; a single one is noise."""
MOST = 24
"""Posts at once, the nearest ones."""
_SMALLEST, _LARGEST = 0.12, 0.45
"""m, radius of a post."""
_SAME = 0.6
"""m within which a post of the next scan is the same one."""
_STILL = 0.04
"""m that a post may seem to move and is left where it stands."""
_GRACE = 0.4
"""s that a post stays after it was seen last."""

Points = npt.NDArray[np.floating[Any]]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Post:
    """Something upright at `x`, `y` of the map, `radius` m wide to each side."""

    x: float
    y: float
    radius: float


class Known:
    """Which parts of the floor are free and away from walls, so that a reading there is news."""

    def __init__(self, grid: telemetry.Map) -> None:
        cells = np.frombuffer(grid.cells, np.uint8).reshape(grid.height, grid.width)
        around = near(cells == 100, math.ceil(EXPLAINED / grid.resolution))
        self._news = ~around & (cells != 255)  # of what is unknown the map explains nothing
        self._resolution = grid.resolution
        self._origin = np.array([grid.origin_x, grid.origin_y])

    def unexplained(self, points: Points) -> Mask:
        """Which of the points (N, 2) of the map frame no wall explains."""
        cells = np.floor((points - self._origin) / self._resolution).astype(np.int64)
        rows, columns = cells[:, 1], cells[:, 0]
        on_map = (rows >= 0) & (columns >= 0) & (rows < self._news.shape[0]) & (columns < self._news.shape[1])
        news = np.zeros(len(points), np.bool_)
        news[on_map] = self._news[rows[on_map], columns[on_map]]
        return news


def near(mask: Mask, radius: int) -> Mask:
    """The cells within `radius` cells of a true one."""
    wide = [mask]  # widened to both sides by 0, 1, 2 … cells
    for by in range(1, radius + 1):
        wider = wide[-1].copy()
        wider[:, by:] |= mask[:, :-by]
        wider[:, :-by] |= mask[:, by:]
        wide.append(wider)
    found = wide[radius].copy()
    for up in range(1, radius + 1):
        row = wide[math.isqrt(radius * radius - up * up)]
        found[up:] |= row[:-up]
        found[:-up] |= row[up:]
    return found


def seen(hits: Points, robot: telemetry.Pose, known: Known) -> list[Post]:
    """The posts of one scan, the nearest first; `hits` are its points (N, 2) of the map frame in their order."""
    here = np.array([robot.x, robot.y])
    near_enough = hits[np.hypot(*(hits - here).T) < REACH]
    points = near_enough[known.unexplained(near_enough)]
    posts = [_post(cluster, here) for cluster in _clusters(points) if len(cluster) >= FEWEST]
    posts.sort(key=lambda post: math.dist((post.x, post.y), (robot.x, robot.y)))
    return posts[:MOST]


def _clusters(points: Points) -> list[Points]:
    """Neighbouring readings that belong together, in the order of the scan."""
    clusters: list[list[Points]] = []
    for point in points:
        last = clusters[-1] if clusters else None
        if last is not None and _apart(last[-1], point) < GAP and _apart(last[0], point) < WIDEST:
            last.append(point)
        else:
            clusters.append([point])
    if len(clusters) > 1:  # a scan goes all around: its end may touch its begin
        first, last = clusters[0], clusters[-1]
        if _apart(last[-1], first[0]) < GAP and _apart(last[0], first[-1]) < WIDEST:
            clusters[0] = clusters.pop() + first
    return [np.array(cluster) for cluster in clusters]


def _apart(one: Points, other: Points) -> float:
    return math.dist(one, other)


def _post(cluster: Points, robot: Points) -> Post:
    """The laser sees the near side alone: the post's middle lies behind it."""
    middle = cluster.mean(axis=0)
    radius = min(max(math.dist(cluster[0], cluster[-1]) / 2 + 0.03, _SMALLEST), _LARGEST)
    away = middle - robot
    length = float(np.linalg.norm(away)) or 1.0
    x, y = middle + away / length * radius / 2
    return Post(float(x), float(y), radius)


class Posts:
    """A fixed number of places for posts. `shown[i]` is the post in the place i; None where there is none."""

    def __init__(self) -> None:
        self.shown: list[Post | None] = [None] * MOST
        self._seen = [-math.inf] * MOST  # when each was seen last

    def update(self, posts: Sequence[Post], now: float) -> None:
        """Give each post the place of the one that it was before, and forget those that were not seen for a while."""
        free = {i for i, post in enumerate(self.shown) if post is None}
        pairs = sorted(
            (math.dist((new.x, new.y), (old.x, old.y)), j, i)
            for j, new in enumerate(posts)
            for i, old in enumerate(self.shown)
            if old is not None
        )
        placed: dict[int, int] = {}
        taken: set[int] = set()
        for distance, j, i in pairs:
            if distance < _SAME and j not in placed and i not in taken:
                placed[j] = i
                taken.add(i)
        for i, old in enumerate(self.shown):
            if old is not None and i not in taken and now - self._seen[i] > _GRACE:
                self.shown[i] = None
                free.add(i)
        for j, new in enumerate(posts):
            i = placed.get(j, -1)
            if i < 0:
                if not free:
                    continue
                i = min(free)
                free.remove(i)
            self._seen[i] = now
            self.shown[i] = _calmed(self.shown[i], new)

    def clear(self) -> None:
        """Forget all."""
        self.shown = [None] * MOST


def _calmed(old: Post | None, new: Post) -> Post:
    """The old one unless it has moved: a reading is never twice the same, and each change costs."""
    if old is None or math.dist((old.x, old.y), (new.x, new.y)) > _STILL or abs(old.radius - new.radius) > 2 * _STILL:
        return new
    return old
