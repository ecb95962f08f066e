"""The safety layer: rules between a tool and the robot. Deterministic, and they trust nobody.

Each rule is a plain function that returns nothing or raises `Refusal`; none of them knows a tool, a socket or a clock.
Speed limits and the protective stop are the robot's own; these rules decide what may begin at all.
"""

from __future__ import annotations

import math

import numpy as np

from backend.config import Limits
from backend.mcp_robot.grid import FREE, OCCUPIED, OccupancyGrid
from backend.mcp_robot.places import at_dock
from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.robot import TopologicalMap
from backend.telemetry import Battery, Pose, Stop

GOAL_MARGIN = 0.05
"""Free space in m that a goal needs around the footprint."""
MAX_TURN_DEGREES = 3600.0


def finite(**numbers: float | None) -> None:
    """Every number is one: neither NaN nor infinite."""
    for name, value in numbers.items():
        if value is not None and not math.isfinite(value):
            raise Refusal("not_finite", f"{name} must be an ordinary number, not {value}.")


def not_stopped(stop: Stop | None) -> None:
    """The stop latch is not set."""
    if stop:
        raise Refusal("stopped", f"Stopped by {stop.by}. A supervisor has to release it.")


def idle(activity: str | None) -> None:
    """Nothing else is under way; `activity` says what is, as "driving to lab 2.3.7"."""
    if activity:
        raise Refusal("busy", f"The robot is {activity}. Wait until that is done, or cancel it.")


def goal_is_free(grid: OccupancyGrid, goal: Pose, footprint_radius: float) -> None:
    """The goal lies on the map, on floor that is known to be free, with room for the footprint."""
    where = f"({goal.x:.1f}, {goal.y:.1f})"
    state = grid.state(goal.x, goal.y)
    if state is None:
        x0, y0 = grid.origin_x, grid.origin_y
        x1, y1 = x0 + grid.width * grid.resolution, y0 + grid.height * grid.resolution
        extent = f"x from {x0:.1f} to {x1:.1f}, y from {y0:.1f} to {y1:.1f}"
        raise Refusal("outside_map", f"The goal {where} is outside the map ({extent}).")
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


def _advice(grid: OccupancyGrid, goal: Pose, needed: float, reach: float = 2.0) -> str:
    """Where it is free near there."""
    cells = np.arange(-reach, reach + 0.05, 0.1)
    dx, dy = (a.ravel() for a in np.meshgrid(cells, cells))
    points = np.stack([goal.x + dx, goal.y + dy], axis=1)
    free = grid.clearances(points) >= needed + 0.05
    if not free.any():
        return "Choose a free spot."
    x, y = points[free][np.argmin(np.hypot(dx, dy)[free])]
    return f"Choose a free spot, as near as ({x:.1f}, {y:.1f})."


def battery_suffices(battery: Battery, goal: Pose | None, places: TopologicalMap, limits: Limits) -> None:
    """There is charge enough to move, or the goal is a dock."""
    if battery.level >= limits.battery_floor:
        return
    if goal and at_dock(goal, places):
        return
    names = " or ".join(place.name for place in places.places if place.kind == "docking")
    where = f" Send it to the {names} first." if names else " It has to be charged first."
    percent = f"{battery.level:.0%}, below {limits.battery_floor:.0%}"
    raise Refusal("battery_low", f"The battery is at {percent}.{where}")


def turn_fits(degrees: float) -> None:
    """Not more than ten turns at once."""
    if abs(degrees) > MAX_TURN_DEGREES:
        raise Refusal("too_long", f"A turn of {degrees:.0f}° is more than {MAX_TURN_DEGREES:.0f}° at once.")


def speech_fits(text: str, limits: Limits) -> None:
    """There is something to say, and not too much of it."""
    if not text.strip():
        raise Refusal("empty", "There is nothing to say in an empty text.")
    if len(text) > limits.max_speech_chars:
        raise Refusal(
            "too_long", f"The text has {len(text)} characters; {limits.max_speech_chars} are the most at once."
        )
