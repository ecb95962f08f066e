"""Sprites of people for the camera's picture: scaled by distance, and hidden by what stands before them.

Plain functions over a picture and the depth of each of its pixels. Nothing may navigate by them.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from backend.mcp_robot.navigation.grid import Floats32
from backend.mcp_robot.simulator.legend import Colour

HEIGHT = 1.72
"""Height of a person in m."""
WIDTH = 0.5
"""Width of a person in m."""
CLOTHES: list[tuple[Colour, Colour]] = [
    ((176, 72, 64), (52, 58, 72)),
    ((70, 112, 150), (70, 62, 56)),
    ((232, 232, 228), (60, 96, 110)),
    ((96, 128, 88), (44, 46, 54)),
    ((206, 160, 84), (62, 66, 84)),
]
"""Colours of shirt and trousers; the nth person wears the nth pair."""
SKIN, HAIR = (214, 172, 140), (72, 54, 42)
DRAWN = 240
"""Height in pixels at which a sprite is drawn before it is scaled."""


def sprite(number: int, facing: bool) -> Image.Image:
    """One person, `facing` the camera or not, on a transparent ground."""
    shirt, trousers = CLOTHES[number % len(CLOTHES)]
    unit = DRAWN / HEIGHT
    image = Image.new("RGBA", (round(WIDTH * unit), DRAWN))
    draw = ImageDraw.Draw(image)
    middle = image.width / 2

    def box(half: float, low: float, high: float, aside: float = 0.0) -> tuple[float, float, float, float]:
        x = middle + aside * unit
        return x - half * unit, DRAWN - high * unit, x + half * unit, DRAWN - low * unit - 1

    for side in (-0.1, 0.1):
        draw.rounded_rectangle(box(0.085, 0.0, 0.88, side), 0.04 * unit, fill=trousers)
        draw.rounded_rectangle(box(0.095, 0.0, 0.09, side), 0.03 * unit, fill=(38, 36, 36))
        draw.rounded_rectangle(box(0.05, 0.72, 1.4, side * 2.05), 0.05 * unit, fill=tuple(c * 9 // 10 for c in shirt))
    draw.rounded_rectangle(box(0.18, 0.84, 1.46), 0.08 * unit, fill=shirt)
    draw.rectangle(box(0.045, 1.42, 1.52), fill=SKIN)
    draw.ellipse(box(0.1, 1.48, HEIGHT), fill=HAIR)
    if facing:
        draw.ellipse(box(0.085, 1.48, 1.67), fill=SKIN)
    return image


def paste(
    picture: Image.Image, sprite: Image.Image, box: tuple[int, int, int, int], depth: float, far: Floats32
) -> None:
    """Paste a sprite into `box` (left, top, right, bottom) of a picture, where the picture is farther away than `depth`
    (m); `far` is the depth of each pixel in m."""
    left, top, right, bottom = box
    scaled = sprite.resize((max(1, right - left), max(1, bottom - top)))
    pixels = np.asarray(scaled)
    x0, y0 = max(left, 0), max(top, 0)
    x1, y1 = min(left + scaled.width, picture.width), min(top + scaled.height, picture.height)
    if x0 >= x1 or y0 >= y1:
        return
    seen = pixels[y0 - top : y1 - top, x0 - left : x1 - left]
    opaque: npt.NDArray[np.bool_] = (seen[..., 3] > 127) & (far[y0:y1, x0:x1] > depth)
    mask = Image.fromarray(np.where(opaque, np.uint8(255), np.uint8(0)))
    picture.paste(Image.fromarray(np.ascontiguousarray(seen[..., :3])), (x0, y0), mask)
