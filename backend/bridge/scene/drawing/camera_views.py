"""Where a viewer's camera stands: all of the map obliquely or from above, or behind the robot.

The whole map fits into a narrow pane as into a wide one: in a pane that is much taller than the map is, the view
looks along the map's other side where that shows it larger.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from backend.bridge.scene.shapes import Extent
from backend.telemetry import Pose

FIELD_OF_VIEW = math.radians(40)
"""Vertical; narrow enough that far rooms do not shrink much."""

TYPICAL_ASPECT = 1.3
"""Of a pane that has not told its shape yet."""

_OBLIQUE = math.radians(62)
_OVERHEAD = math.radians(89.5)
"""Not 90: a camera that looks straight down has no up."""
_MARGIN = 1.05
_WORTH_TURNING = 1.3
_HEAD_ROOM = 1.6
"""m above the floor that have to be seen too."""

_BEHIND, _ABOVE, _AHEAD = 4.2, 3.6, 1.2
"""m that the camera follows behind and above the robot, and looks ahead of it."""
_NARROW = 0.9
"""Panes narrower than this, width to height, see too little of what is beside the robot."""

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """A camera pose: its position and the point of the floor that it looks at, in m."""

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]


def fitting(extent: Extent, aspect: float) -> View:
    """The nearest oblique view that shows all of `extent` in a pane of that width to height."""
    return _fitting(extent, aspect, _OBLIQUE)


def overhead(extent: Extent, aspect: float) -> View:
    """The same from straight above."""
    return _fitting(extent, aspect, _OVERHEAD)


def behind(robot: Pose, aspect: float) -> View:
    """The view over the robot's shoulder."""
    back = max(1.0, _NARROW / aspect)
    cos, sin = math.cos(robot.yaw), math.sin(robot.yaw)
    return View(
        (robot.x - cos * _BEHIND * back, robot.y - sin * _BEHIND * back, _ABOVE * back),
        (robot.x + cos * _AHEAD, robot.y + sin * _AHEAD, 0.0),
    )


@lru_cache(maxsize=256)  # every page asks again with each report, for one of few shapes
def _fitting(extent: Extent, aspect: float, elevation: float) -> View:
    north, north_distance = _looking(extent, aspect, math.pi / 2, elevation)
    west, west_distance = _looking(extent, aspect, math.pi, elevation)
    return west if west_distance * _WORTH_TURNING < north_distance else north


def _looking(extent: Extent, aspect: float, azimuth: float, elevation: float) -> tuple[View, float]:
    """The view along a compass direction, so many rad downwards, and its distance from what it looks at."""
    level = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    vertical = np.array([0.0, 0.0, 1.0])
    forward = level * math.cos(elevation) - vertical * math.sin(elevation)
    up = level * math.sin(elevation) + vertical * math.cos(elevation)
    right = np.cross(forward, up)

    x0, y0, x1, y1 = extent
    centre = np.array([(x0 + x1) / 2, (y0 + y1) / 2, 0.0])
    corners = np.array([(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (0.0, _HEAD_ROOM)]) - centre
    slope = math.tan(FIELD_OF_VIEW / 2) / _MARGIN
    along = corners @ forward
    shift_x, distance_x = _fit(corners @ right, along, slope * aspect)
    shift_y, distance_y = _fit(corners @ up, along, slope)
    distance = max(distance_x, distance_y)

    position = centre + right * shift_x + up * shift_y - forward * distance
    to_floor = -position[2] / forward[2]
    look_at = position + forward * to_floor
    return View(_triple(position), _triple(look_at)), distance


def _fit(across: Vector, along: Vector, slope: float) -> tuple[float, float]:
    """How far to shift sideways and to step back so that every point is within `slope` of the view's axis.

    A point at `across`, `along` is seen when |across - shift| <= (distance + along) * slope. The smallest
    distance is where the bounds of both sides meet.
    """
    one = float(np.max(across / slope - along))
    other = float(np.max(-across / slope - along))
    return slope * (one - other) / 2, (one + other) / 2


def _triple(vector: Vector) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])
