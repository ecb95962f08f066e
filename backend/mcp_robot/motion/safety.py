"""The safety rules before a motion: they decide what may begin, whoever asks, and they are deterministic.

Each rule is a plain function that returns nothing or raises `Refusal`; none of them knows a tool, a socket or a clock.
guard.py has the rules while the robot moves.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from backend.config import Limits
from backend.mcp_robot.motion import keep_out
from backend.mcp_robot.navigation.grid import FARTHEST, FREE, OCCUPIED, Floats, OccupancyGrid
from backend.mcp_robot.navigation.named_places import at_dock
from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.robot import Capabilities, TopologicalMap
from backend.telemetry import Battery, Pose, Stop, Zone

GOAL_MARGIN = 0.05
"""Free space in m that a goal needs around the footprint."""
PATH_MARGIN = 0.05
"""How much nearer (m) to a wall than its footprint a planned path may pass: about what a map's cells leave open."""
PATH_STEP = 0.05
"""Metres between the points of a path that are checked."""
LONGEST = 20_000.0
"""Metres beyond which the length of a path cannot be right."""
LET_OUT = 0.6
"""For the first so many m a path may be as near to a wall as the robot already stands."""
MAX_TURN_DEGREES = 3600.0


def finite(**numbers: float | None) -> None:
    """Every number is finite: neither NaN nor infinite."""
    for name, value in numbers.items():
        if value is not None and not math.isfinite(value):
            raise Refusal("not_finite", f"{name} must be an ordinary number, not {value}.")


def goal_is_ordinary(goal: Pose) -> None:
    """The goal's numbers are finite, and small enough to compute with: no farther than FARTHEST, at most ten turns."""
    finite(x=goal.x, y=goal.y, yaw=goal.yaw)
    if max(abs(goal.x), abs(goal.y)) > FARTHEST:
        raise Refusal("outside_map", f"The goal ({goal.x:g}, {goal.y:g}) is outside every map. Coordinates are in m.")
    most = math.radians(MAX_TURN_DEGREES)
    if abs(goal.yaw) > most:
        raise Refusal("bad_arguments", f"A yaw is in rad, from {-most:.1f} to {most:.1f}, not {goal.yaw:g}.")


def not_stopped(stop: Stop | None) -> None:
    """The stop latch is not set."""
    if stop:
        raise Refusal("stopped", f"Stopped by {stop.by}. A supervisor has to release it.")


def idle(activity: str | None) -> None:
    """Nothing else is under way. `activity` names what is, such as "driving to lab 2.3.7"; None for nothing."""
    if activity:
        raise Refusal("busy", f"The robot is {activity}. Wait until that is done, or cancel it.")


def goal_is_free(grid: OccupancyGrid, goal: Pose, footprint_radius: float) -> None:
    """The goal lies on the map, on floor that is known to be free, with room for the footprint."""
    where = f"({goal.x:.1f}, {goal.y:.1f})"
    state = grid.state(goal.x, goal.y)
    if state is None:
        raise Refusal("outside_map", f"The goal {where} is outside the map ({grid.extent}).")
    needed = footprint_radius + GOAL_MARGIN
    if grid.clearance(goal.x, goal.y) >= needed:
        return
    advice = _advice(grid, goal, needed)
    if state == OCCUPIED:
        raise Refusal("occupied", f"The goal {where} is inside a wall or a piece of furniture. {advice}")
    if state != FREE:
        raise Refusal("occupied", f"The goal {where} is in an unknown part of the map. {advice}")
    raise Refusal(
        "occupied", f"The goal {where} is too close to a wall: the robot needs {needed:.2f} m around it. {advice}"
    )


def misplaced(grid: OccupancyGrid, x: float, y: float, footprint_radius: float) -> str | None:
    """Why no robot can be sent to a place at this point of the map, as the end of a sentence; None when it can be."""
    where, needed = f"({x:g}, {y:g})", footprint_radius + GOAL_MARGIN
    state = grid.state(x, y)
    if state is None:
        return (
            f"{where} is outside the map ({grid.extent}). Look at its position, and at the map's resolution and origin."
        )
    if grid.clearance(x, y) >= needed:
        return None
    advice = _advice(grid, Pose(x, y, 0.0), needed)
    if state != FREE:
        return f"{where} is not on free floor. {advice}"
    return f"{where} is too close to a wall: the robot needs {needed:.2f} m around it. {advice}"


def goal_keeps_out(zones: Sequence[Zone], grid: OccupancyGrid, goal: Pose, footprint_radius: float) -> None:
    """The footprint at the goal touches no keep-out zone, nor any cell that one touches."""
    near = keep_out.nearest(zones, goal.x, goal.y)
    needed = footprint_radius + GOAL_MARGIN + 2 * grid.resolution
    if near and near[0] < needed:
        advice = _advice(grid, goal, footprint_radius + GOAL_MARGIN, zones)
        where = f"({goal.x:.1f}, {goal.y:.1f})"
        how = "in" if near[0] <= 0 else "too close to"
        raise Refusal("keep_out", f"The goal {where} is {how} the keep-out zone {near[1].name}. {advice}")


def path_is_free(grid: OccupancyGrid, zones: Sequence[Zone], points: Floats, footprint_radius: float) -> None:
    """The footprint fits everywhere along a planned path, shape (n, 2): on the map, beside walls, off the zones.

    A robot that already stands too near to something may drive out: for the first LET_OUT m it must only get no nearer.
    """
    if not len(points) or not np.isfinite(points).all() or np.abs(points).max() > FARTHEST or _length(points) > LONGEST:
        raise Refusal("not_finite", "The way that was planned has points that are no places. Choose another goal.")
    points, way = _dense(points)
    first = way <= LET_OUT
    room = grid.clearances(points)
    needed = footprint_radius - PATH_MARGIN
    tight = room < np.where(first, min(needed, float(room[0]) - PATH_MARGIN), needed)
    if tight.any():
        x, y = points[int(np.argmax(tight))]
        if grid.state(x, y) is None:
            raise Refusal("outside_map", f"The way leads off the map at ({x:.1f}, {y:.1f}). Choose another goal.")
        raise Refusal("occupied", f"The way is too tight at ({x:.1f}, {y:.1f}). Choose another goal.")
    apart = keep_out.distances(zones, points)
    inside = apart < np.where(first, min(footprint_radius, float(apart[0]) - PATH_MARGIN), footprint_radius)
    if inside.any():
        x, y = points[int(np.argmax(inside))]
        near = keep_out.nearest(zones, x, y)
        name = near[1].name if near else ""
        raise Refusal("keep_out", f"The way leads through the keep-out zone {name} at ({x:.1f}, {y:.1f}).")


def _length(points: Floats) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def _dense(points: Floats) -> tuple[Floats, Floats]:
    """The same path with points at most PATH_STEP apart, shape (n, 2), and the distance of each along it, in m."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    along = np.union1d(way, np.arange(0.0, way[-1], PATH_STEP))
    return np.stack([np.interp(along, way, points[:, 0]), np.interp(along, way, points[:, 1])], axis=1), along


def _advice(grid: OccupancyGrid, goal: Pose, needed: float, zones: Sequence[Zone] = (), reach: float = 2.0) -> str:
    """A sentence with the free point that is nearest to the goal, within `reach` m."""
    cells = np.arange(-reach, reach + 0.05, 0.1)
    dx, dy = (a.ravel() for a in np.meshgrid(cells, cells))
    points = np.stack([goal.x + dx, goal.y + dy], axis=1)
    free = (grid.clearances(points) >= needed + 0.05) & (
        keep_out.distances(zones, points) >= needed + 2 * grid.resolution + 0.05
    )
    if not free.any():
        return "Choose a free spot."
    x, y = points[free][np.argmin(np.hypot(dx, dy)[free])]
    return f"Choose a free spot, as near as ({x:.1f}, {y:.1f})."


def battery_suffices(battery: Battery, goal: Pose | None, places: TopologicalMap, limits: Limits) -> None:
    """The charge is above the floor, or the goal is a dock."""
    if battery.level >= limits.battery_floor:
        return
    if goal and at_dock(goal, places):
        return
    percent = f"{battery.level:.0%}, below {limits.battery_floor:.0%}"
    raise Refusal("battery_low", f"The battery is at {percent}.{where_to_charge(places)}")


def where_to_charge(places: TopologicalMap) -> str:
    """A sentence on what to do with an empty battery."""
    names = " or ".join(place.name for place in places.places if place.kind == "docking")
    return f" Send it to the {names} first." if names else " It has to be charged first."


def turn_fits(degrees: float) -> None:
    """Not more than ten full turns in one motion."""
    if abs(degrees) > MAX_TURN_DEGREES:
        raise Refusal("too_long", f"A turn of {degrees:g}° is more than {MAX_TURN_DEGREES:.0f}° at once.")


def has_camera(capabilities: Capabilities) -> None:
    """The robot has a camera."""
    if not capabilities.camera:
        raise Refusal("no_camera", "This robot has no camera.")


def has_voice(capabilities: Capabilities) -> None:
    """The robot has a voice."""
    if not capabilities.voice:
        raise Refusal("no_voice", "This robot has no voice.")


def speech_fits(text: str, limits: Limits) -> None:
    """The text is not empty, not too long, and can be written down."""
    if not text.strip():
        raise Refusal("empty", "There is nothing to say in an empty text.")
    if len(text) > limits.max_speech_chars:
        raise Refusal(
            "too_long", f"The text has {len(text)} characters; {limits.max_speech_chars} are the most at once."
        )
    if any("\ud800" <= character <= "\udfff" for character in text):
        raise Refusal("bad_arguments", "The text has halves of characters (lone surrogates). Send whole ones.")


class Rate:
    """Not more than `most` of something within any minute; `what` names it in the plural, such as "motions". The caller
    passes the time in."""

    def __init__(self, what: str, most: int) -> None:
        self._what = what
        self._most = most
        self._begun: deque[float] = deque(maxlen=most)  # when each of the latest ones began, in s

    def take(self, now: float) -> None:
        """Count one more that begins at `now` (s). Raises `Refusal` (too_often)."""
        oldest = self._begun[0] if len(self._begun) == self._most else -math.inf
        left = oldest + 60.0 - now
        if 0.0 < left <= 60.0:  # more than 60 s would mean that the clock was set back
            raise Refusal(
                "too_often",
                f"{self._most} {self._what} were begun within a minute, the most that is allowed. "
                f"Ask again in {math.ceil(left)} s.",
            )
        self._begun.append(now)
