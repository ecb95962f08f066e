"""Where a camera stands for each view: all of the map obliquely or from above, or behind the robot.

The whole map fits into a narrow pane as into a wide one: in a pane that is much taller than the map is, the view
is along the map's other side where that shows the map larger. Plain functions; lengths in m of the map frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from backend.bridge.scene.drawing.shapes import Extent
from backend.telemetry import Pose

FIELD_OF_VIEW = math.radians(40)
"""Vertical; narrow enough that far rooms do not look much smaller."""

TYPICAL_ASPECT = 1.3
"""Width to height of a pane that has not reported its shape yet."""

_MAP_ELEVATION = math.radians(62)
_TOP_ELEVATION = math.radians(89.5)
"""How far down the camera looks. Not 90°: a camera that looks straight down has no up direction."""
_MARGIN = 1.05
_WORTH_TURNING = 1.3
"""How many times nearer the camera has to come before the map is shown from its other side."""
_HEAD_ROOM = 1.6
"""m above the floor that have to be visible as well."""

_FOLLOW_BEHIND, _FOLLOW_ABOVE, _FOLLOW_AHEAD = 4.2, 3.6, 1.2
"""m that the following camera stands behind and above the robot, and looks ahead of it."""
_NARROW_ASPECT = 0.9
"""A pane narrower than this shows too little beside the robot, so the following camera stands further away."""

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """A camera pose: its position and the point that it looks at, in m of the map frame."""

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]


# Each page's report of its camera asks for the same few views again, so both views are cached.


@lru_cache(maxsize=256)
def map_view(extent: Extent, aspect: float) -> View:
    """The nearest oblique view that shows all of `extent` in a pane of that width to height."""
    return _view_of(extent, aspect, _MAP_ELEVATION)


@lru_cache(maxsize=256)
def top_view(extent: Extent, aspect: float) -> View:
    """The nearest view from above that shows all of `extent` in a pane of that width to height."""
    return _view_of(extent, aspect, _TOP_ELEVATION)


def follow_view(robot: Pose, aspect: float) -> View:
    """The view over the robot's shoulder."""
    scale = max(1.0, _NARROW_ASPECT / aspect)
    cos, sin = math.cos(robot.yaw), math.sin(robot.yaw)
    behind, above = _FOLLOW_BEHIND * scale, _FOLLOW_ABOVE * scale
    return View(
        (robot.x - cos * behind, robot.y - sin * behind, above),
        (robot.x + cos * _FOLLOW_AHEAD, robot.y + sin * _FOLLOW_AHEAD, 0.0),
    )


def _view_of(extent: Extent, aspect: float, elevation: float) -> View:
    north, north_distance = _view_along(extent, aspect, math.pi / 2, elevation)
    west, west_distance = _view_along(extent, aspect, math.pi, elevation)
    return west if west_distance * _WORTH_TURNING < north_distance else north


def _view_along(extent: Extent, aspect: float, azimuth: float, elevation: float) -> tuple[View, float]:
    """The view in direction `azimuth`, `elevation` rad downwards, and the camera's distance from the map's middle."""
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
