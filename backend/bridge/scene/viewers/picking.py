"""Which point of the floor a click means, and which place is there. Plain functions; a pick commands nothing."""

from __future__ import annotations

import math
from collections.abc import Iterable

from backend.bridge.scene.shapes import NAME_OFFSET, Extent
from backend.bridge.scene.viser_wire import Click
from backend.telemetry import Place

AROUND_PLACE = 1.0
"""m from a place within which a click means it."""
AROUND_NAME = 0.6
"""The same from the middle of its name."""


def on_floor(click: Click, extent: Extent) -> tuple[float, float] | None:
    """Where the ray meets the floor of the map; None where it does not."""
    (ox, oy, oz), (dx, dy, dz) = click.origin, click.direction
    if oz <= 0 or dz >= 0:
        return None
    along = -oz / dz
    x, y = ox + dx * along, oy + dy * along
    x0, y0, x1, y1 = extent
    return (x, y) if x0 <= x <= x1 and y0 <= y <= y1 else None


def place_at(point: tuple[float, float], places: Iterable[Place]) -> str | None:
    """The name of the nearest place that a click there means."""
    nearest, name = math.inf, None
    for place in places:
        x, y = place.pose.x, place.pose.y
        share = min(math.dist(point, (x, y)) / AROUND_PLACE, math.dist(point, (x, y - NAME_OFFSET)) / AROUND_NAME)
        if share <= 1.0 and share < nearest:
            nearest, name = share, place.name
    return name
