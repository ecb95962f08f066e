"""Keep-out zones as a part of the floor's picture: a red tint with stripes and a border.

They are painted, so that they cost no nodes and no frame rate. Plain functions over arrays. Here they are only drawn:
the robot server keeps the robot out of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from backend.telemetry import Zone

COLOUR = (220, 38, 38)
STRIPE = 0.5
"""m from one stripe to the next."""
BORDER = 0.06
"""m wide."""
_TINT_OPACITY, _STRIPE_OPACITY, _BORDER_OPACITY = 0.12, 0.3, 0.85

Picture = npt.NDArray[np.uint8]
Point = tuple[float, float]


def paint(picture: Picture, zones: Sequence[Zone], pixel: float, origin: Point) -> None:
    """Paint zones into a floor's picture: its row and column 0 are at `origin`, a pixel is `pixel` m wide."""
    height, width = picture.shape[:2]
    for zone in zones:
        if len(zone.polygon) < 3:
            continue
        corners = [((x - origin[0]) / pixel, (y - origin[1]) / pixel) for x, y in zone.polygon]
        inside = Image.new("1", (width, height))
        draw = ImageDraw.Draw(inside)
        draw.polygon(corners, fill=1)
        border = Image.new("1", (width, height))
        ImageDraw.Draw(border).line([*corners, corners[0]], fill=1, width=max(1, round(BORDER / pixel)), joint="curve")
        rows, columns = _bounds(corners, width, height)
        if rows.stop <= rows.start or columns.stop <= columns.start:
            continue
        across = np.add.outer(np.arange(rows.start, rows.stop), np.arange(columns.start, columns.stop)) * pixel
        striped = across % STRIPE < STRIPE / 2
        opacity = np.where(striped, _STRIPE_OPACITY, _TINT_OPACITY) * np.asarray(inside, np.bool_)[rows, columns]
        opacity = np.where(np.asarray(border, np.bool_)[rows, columns], _BORDER_OPACITY, opacity)[..., None]
        part = picture[rows, columns]
        picture[rows, columns] = (part * (1 - opacity) + np.array(COLOUR) * opacity).astype(np.uint8)


def centroid(polygon: Sequence[Point]) -> Point:
    """The centroid of a polygon; the mean of its corners where it has no area."""
    corners = np.array(polygon, float)
    after = np.roll(corners, -1, axis=0)
    cross = corners[:, 0] * after[:, 1] - after[:, 0] * corners[:, 1]
    area = cross.sum() / 2
    if abs(area) < 1e-9:
        x, y = corners.mean(axis=0)
    else:
        x, y = ((corners + after) * cross[:, None]).sum(axis=0) / (6 * area)
    return float(x), float(y)


def _bounds(corners: Sequence[Point], width: int, height: int) -> tuple[slice, slice]:
    """The rows and columns of the picture that a zone and its border can touch."""
    margin = 8  # pixels, more than half a border
    xs, ys = [x for x, _ in corners], [y for _, y in corners]
    columns = slice(max(0, int(min(xs)) - margin), min(width, int(max(xs)) + margin))
    rows = slice(max(0, int(min(ys)) - margin), min(height, int(max(ys)) + margin))
    return rows, columns
