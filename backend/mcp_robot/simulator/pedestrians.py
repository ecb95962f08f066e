"""Pedestrians: each walks a closed path between places, with pauses, clear of walls, each other and the robot.

Plain state in time, seeded: the same steps give the same people. Their paths are planned once and walked forwards or
backwards, so that a step costs next to nothing. Nobody walks into the robot: they stop before it, stand in its way, and
turn round when that lasts. The robot knows of them only by its laser and its camera.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from backend.mcp_robot.navigation import planner
from backend.mcp_robot.navigation.grid import Floats, OccupancyGrid
from backend.mcp_robot.simulator.laser import Disc
from backend.telemetry import Pose

RADIUS = 0.22
"""Radius of a person in m."""
WALKING_ROOM = 0.35
"""Their paths keep so far (m) from walls."""
SPEED = (0.7, 1.2)
"""m/s, of the slowest and of the fastest."""
PAUSE = (2.0, 8.0)
"""Seconds at each place."""
PATIENCE = (3.0, 6.0)
"""Seconds that they wait before something in their way; then they turn round."""
SIDESTEP, SIDESTEP_SPEED = 0.9, 0.5
"""How far (m) and how fast (m/s) they step aside for the robot."""
HURRY = 2.5
"""Nobody moves faster than this (m/s), not even beside their path round a corner."""
PERSONAL_SPACE = 0.25
"""m that they keep between themselves and the robot, beyond the way that it needs to stop."""
STOPS = 3
"""Places on a round."""
START_CLEAR = 2.5
"""Radius in m around the robot in which nobody begins."""

Room = Callable[[float, float], float]
"""Clearance in m of a point from all that stands."""


@dataclass(frozen=True, eq=False)
class Round:
    """A closed path: points about planner.SPACING apart, and the indices of those where a person pauses."""

    points: list[tuple[float, float]]
    stops: frozenset[int]


@dataclass
class Pedestrian:
    """A person on a round. `at` is the position on it as an index of its points, with fractions; `aside` is in m to the
    left of the path, seen forwards; `direction` is 1 or -1; `waiting` and `pausing` are in s."""

    round: Round
    at: float
    speed: float
    patience: float
    direction: int = 1
    aside: float = 0.0
    waiting: float = 0.0
    pausing: float = 0.0

    @property
    def pose(self) -> Pose:
        """Where the person is, and the direction of their face."""
        points = self.round.points
        here, part = int(self.at), self.at - int(self.at)
        (x0, y0), (x1, y1) = points[here % len(points)], points[(here + 1) % len(points)]
        dx, dy = x1 - x0, y1 - y0
        left = self.aside / (math.hypot(dx, dy) or 1.0)
        heading = math.atan2(dy * self.direction, dx * self.direction)
        return Pose(x0 + part * dx - left * dy, y0 + part * dy + left * dx, heading)


class Pedestrians:
    """All pedestrians of a building."""

    def __init__(self, everyone: list[Pedestrian], generator: np.random.Generator) -> None:
        self._everyone = everyone
        self._generator = generator
        self.poses: list[Pose] = [person.pose for person in everyone]  # replaced by `step`

    @property
    def discs(self) -> list[Disc]:
        """The discs that the laser sees."""
        return [(pose.x, pose.y, RADIUS) for pose in self.poses]

    def clearance(self, x: float, y: float) -> float:
        """m from a point to the nearest of them, infinite when there is nobody."""
        return min((math.hypot(p.x - x, p.y - y) - RADIUS for p in self.poses), default=math.inf)

    def step(self, dt: float, room: Room, robot: Pose, keep: float) -> None:
        """Walk for `dt` s, nowhere nearer to the `robot`'s centre than `keep` m plus personal space."""
        for index, person in enumerate(self._everyone):
            if person.pausing > 0.0:
                person.pausing -= dt
                continue
            for change in self._wishes(person, dt):
                before = person.at, person.aside
                person.at, person.aside = change
                there = person.pose
                in_time = _apart(there, self.poses[index]) <= HURRY * dt
                if in_time and self._free(index, there, room, robot, keep):
                    break
                person.at, person.aside = before
            if person.at == before[0]:
                person.waiting += dt
                if person.waiting >= person.patience:
                    person.direction, person.waiting = -person.direction, 0.0
            else:
                person.waiting = 0.0
                self._pause_at_stop(person, before[0])
            self.poses[index] = person.pose

    def _wishes(self, person: Pedestrian, dt: float) -> list[tuple[float, float]]:
        """What a person would do next, best first, as `at` and `aside`: go on and back to the path, or step aside."""
        on = (person.at + person.direction * person.speed * dt / planner.SPACING) % len(person.round.points)
        step = SIDESTEP_SPEED * dt
        back = max(abs(person.aside) - step, 0.0)
        wishes = [(on, math.copysign(back, person.aside)), (on, person.aside)]
        right_first = (person.aside - step, person.aside + step)[:: person.direction]
        return wishes + [(person.at, aside) for aside in right_first if abs(aside) <= SIDESTEP]

    def _pause_at_stop(self, person: Pedestrian, before: float) -> None:
        passed = int(person.at) if person.direction > 0 else int(before)
        if int(person.at) != int(before) and passed in person.round.stops:
            person.pausing = float(self._generator.uniform(*PAUSE))

    def _free(self, index: int, there: Pose, room: Room, robot: Pose, keep: float) -> bool:
        """Whether a person may step there: nothing is too near, or at least the step leads away from it."""
        here = self.poses[index]
        if not _room_or_away(room(there.x, there.y), room(here.x, here.y), RADIUS):
            return False
        others = [(robot, keep + RADIUS + PERSONAL_SPACE)]
        others += [(other, 2 * RADIUS + 0.1) for i, other in enumerate(self.poses) if i != index]
        return all(_room_or_away(_apart(there, other), _apart(here, other), apart) for other, apart in others)


def _apart(one: Pose, other: Pose) -> float:
    return math.hypot(one.x - other.x, one.y - other.y)


def _room_or_away(there: float, here: float, needed: float) -> bool:
    return there >= needed or there > here


def populate(
    grid: OccupancyGrid, places: list[Pose], count: int, robot: Pose, generator: np.random.Generator
) -> Pedestrians:
    """`count` people on rounds between `places`, or between free spots of a map that has none.

    Where there is not enough floor for so many, there are fewer.
    """
    if not count:
        return Pedestrians([], generator)
    search = planner.search_grid(grid, WALKING_ROOM)
    spots = np.array([(p.x, p.y) for p in places]) if len(places) >= STOPS else _spots(grid, generator)
    everyone: list[Pedestrian] = []
    for _ in range(4 * count):
        if len(everyone) == count or len(spots) < STOPS:
            break
        stops = [(float(x), float(y)) for x, y in spots[generator.permutation(len(spots))[:STOPS]]]
        try:
            walk = _round(grid, search, stops)
        except planner.Unreachable:
            continue
        person = Pedestrian(
            walk,
            at=float(generator.uniform(0, len(walk.points))),
            speed=float(generator.uniform(*SPEED)),
            patience=float(generator.uniform(*PATIENCE)),
        )
        if _apart(person.pose, robot) > START_CLEAR and all(_apart(person.pose, p.pose) > 1.0 for p in everyone):
            everyone.append(person)
    return Pedestrians(everyone, generator)


def _round(grid: OccupancyGrid, search: planner.SearchGrid, stops: list[tuple[float, float]]) -> Round:
    points: list[tuple[float, float]] = []
    ends: set[int] = set()
    for start, goal in zip(stops, stops[1:] + stops[:1], strict=True):
        ends.add(len(points))
        way = planner.plan(grid, search, start, goal, WALKING_ROOM)
        points += [(x, y) for x, y in way[:-1].tolist()]
    return Round(points, frozenset(ends))


def _spots(grid: OccupancyGrid, generator: np.random.Generator, count: int = 24) -> Floats:
    rows, columns = np.nonzero(grid.distance > 2 * WALKING_ROOM)
    chosen = generator.permutation(len(rows))[:count]
    x = grid.origin_x + (columns[chosen] + 0.5) * grid.resolution
    y = grid.origin_y + (rows[chosen] + 0.5) * grid.resolution
    return np.stack([x, y], axis=1)
