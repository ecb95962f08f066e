"""Which point of the floor a click means, and which place is there. Plain functions; a click commands nothing."""

from __future__ import annotations

import math
from collections.abc import Iterable

from backend.bridge.scene.drawing.shapes import NAME_OFFSET, Extent
from backend.bridge.scene.viser_internals import Click
from backend.telemetry import Place

PLACE_RADIUS = 1.0
"""m around a place within which a click means that place."""
NAME_RADIUS = 0.6
"""m around the middle of its name within which a click means that place."""


def floor_point(click: Click, extent: Extent) -> tuple[float, float] | None:
    """Where the ray of a click meets the floor, in m of the map frame; None where it misses the map."""
    (ox, oy, oz), (dx, dy, dz) = click.origin, click.direction
    if oz <= 0 or dz >= 0:
        return None
    along = -oz / dz
    x, y = ox + dx * along, oy + dy * along
    x0, y0, x1, y1 = extent
    return (x, y) if x0 <= x <= x1 and y0 <= y <= y1 else None


def place_at(point: tuple[float, float], places: Iterable[Place]) -> str | None:
    """The name of the place that a click at `point` means, the nearest of several; None where there is none."""
    nearest, name = math.inf, None
    for place in places:
        x, y = place.pose.x, place.pose.y
        to_place = math.dist(point, (x, y)) / PLACE_RADIUS
        to_name = math.dist(point, (x, y - NAME_OFFSET)) / NAME_RADIUS
        distance = min(to_place, to_name)  # as a share of the radius
        if distance <= 1.0 and distance < nearest:
            nearest, name = distance, place.name
    return name
