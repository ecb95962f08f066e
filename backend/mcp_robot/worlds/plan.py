"""A floor plan in metres, drawn as an ordinary ROS map: dark is occupied, light is free, middle grey unknown.

Within these classes the shade says what a thing is (see `backend.mcp_robot.simulator.legend`), which only the simulated
camera reads. The same calls give the same picture.
"""

from __future__ import annotations

from PIL import Image, ImageDraw

from backend.mcp_robot.simulator import legend

RESOLUTION = 0.05
MARGIN = 0.5

YAML = f"""\
image: map.png
mode: trinary
resolution: {RESOLUTION}
origin: [{-MARGIN}, {-MARGIN}, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
"""The map.yaml of every plan."""


class Plan:
    """A plan of `width` times `depth` m, y upwards, on a picture in pixels, y downwards. Walls are `wall` m thick."""

    def __init__(self, width: float, depth: float, wall: float) -> None:
        self.wall = wall
        size = (round((width + 2 * MARGIN) / RESOLUTION), round((depth + 2 * MARGIN) / RESOLUTION))
        self.image = Image.new("L", size, legend.UNKNOWN)
        self._draw = ImageDraw.Draw(self.image)
        self._top = depth + MARGIN

    def _pixel(self, x: float, y: float) -> tuple[int, int]:
        return round((x + MARGIN) / RESOLUTION), round((self._top - y) / RESOLUTION)

    def box(self, x0: float, y0: float, x1: float, y1: float, shade: int) -> None:
        """A filled rectangle between two corners."""
        left, bottom = self._pixel(x0, y0)
        right, top = self._pixel(x1, y1)
        self._draw.rectangle((left, top, right - 1, bottom - 1), fill=shade)

    def disc(self, x: float, y: float, radius: float, shade: int) -> None:
        """A filled circle."""
        left, bottom = self._pixel(x - radius, y - radius)
        right, top = self._pixel(x + radius, y + radius)
        self._draw.ellipse((left, top, right - 1, bottom - 1), fill=shade)

    def room(self, x0: float, y0: float, x1: float, y1: float, shade: int) -> None:
        """A floor with walls around it, whose middles lie on the rectangle."""
        half = self.wall / 2
        self.box(x0 - half, y0 - half, x1 + half, y1 + half, legend.WALL)
        self.box(x0 + half, y0 + half, x1 - half, y1 - half, shade)

    def door(self, x: float, y: float, width: float = 1.0) -> None:
        """An opening in a wall along x whose lower edge is at `y`, with a frame left and right."""
        self.box(x - width / 2 - 0.1, y, x + width / 2 + 0.1, y + self.wall, legend.FRAME)
        self.box(x - width / 2, y, x + width / 2, y + self.wall, legend.DOORWAY)

    def door_along_y(self, x: float, y: float, width: float = 1.0) -> None:
        """The same in a wall along y whose left edge is at `x`."""
        self.box(x, y - width / 2 - 0.1, x + self.wall, y + width / 2 + 0.1, legend.FRAME)
        self.box(x, y - width / 2, x + self.wall, y + width / 2, legend.DOORWAY)

    def table(self, x: float, y: float, width: float, depth: float, chairs: int = 0) -> None:
        """A table around its centre, with chairs in front of it (south)."""
        self.box(x - width / 2, y - depth / 2, x + width / 2, y + depth / 2, legend.TABLE)
        for index in range(chairs):
            place = x - width / 2 + (index + 0.5) * width / chairs
            self.box(place - 0.2, y - depth / 2 - 0.35, place + 0.2, y - depth / 2, legend.CHAIR)
