"""The colours of surfaces: of every pixel by its position in the building and by the thing that it shows.

Plain functions over arrays of pixels. Patterns are functions of the position, so that they stay when the robot moves.
For speed a pixel is the number of a colour and a brightness until the very end, and a pattern is computed only where it
is visible: five pictures a second must leave the processor to the guard.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from backend.mcp_robot.navigation.grid import Floats32
from backend.mcp_robot.simulator import legend
from backend.mcp_robot.simulator.world import World

SOLID, FLOOR, CEILING, LINTEL = range(4)

Numbers = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]

_colours: list[legend.Colour] = []


def _number(colour: legend.Colour) -> int:
    """The number of a colour."""
    if colour not in _colours:
        _colours.append(colour)
    return _colours.index(colour)


HAZE: Floats32 = np.array((206.0, 208.0, 206.0), dtype=np.float32)
HAZE_DISTANCE = 26.0
"""m after which 1/e of a colour is left."""
WALL_OF_FLOOR: dict[int, legend.Colour] = {
    legend.WOOD: (232, 216, 190),
    legend.TILES: (214, 224, 214),
    legend.CARPET: (224, 224, 216),
    legend.FLOOR: (230, 228, 220),
    legend.DOORWAY: (226, 222, 212),
}
_RAIL = _number((92, 132, 146))
_SKY = _number((190, 214, 236))
_HILLS = _number((146, 172, 138))
_WINDOW_FRAME = _number((240, 240, 238))
_ABOVE_DOOR = _number((222, 219, 210))
_LINTEL = _number((218, 215, 206))
_FRAME = _number(legend.THINGS[legend.FRAME].side)
_CEILING = _number((236, 236, 236))
_JOINT = _number((218, 218, 218))
_LAMP = _number((255, 254, 246))
_WORKTOP = _number(legend.THINGS[legend.COUNTER].top)
_POT = _number((158, 98, 72))
_DOCK_LIGHT = _number((90, 220, 140))
_BOOKS: Numbers = np.array(
    [
        _number(colour)
        for colour in ((148, 62, 54), (60, 92, 120), (196, 166, 92), (84, 110, 84), (120, 84, 110), (205, 200, 188))
    ],
    dtype=np.uint8,
)


def _by_shade(colour_of: dict[int, legend.Colour], nearest_below: bool) -> Numbers:
    keys = sorted(colour_of)
    numbers = []
    for shade in range(256):
        if nearest_below:
            key = max((k for k in keys if k <= shade), default=keys[0])
        else:
            key = min(keys, key=lambda k: abs(k - shade))
        numbers.append(_number(colour_of[key]))
    return np.array(numbers, dtype=np.uint8)


_SIDES = _by_shade({shade: thing.side for shade, thing in legend.THINGS.items()}, nearest_below=True)
_TOPS = _by_shade({shade: thing.top for shade, thing in legend.THINGS.items()}, nearest_below=True)
_FLOORS = _by_shade(legend.FLOORS, nearest_below=False)
_WALLS = _by_shade(WALL_OF_FLOOR, nearest_below=False)
_IS_WALL: Mask = np.isin(np.arange(256), (legend.WALL, legend.WINDOW, legend.UNKNOWN))
_PALETTE: Floats32 = np.array(_colours, dtype=np.float32)


def _heights() -> Floats32:
    heights = np.zeros(256, dtype=np.float32)
    for shade in range(legend.UNKNOWN):
        heights[shade] = legend.thing(shade).height
    heights[legend.UNKNOWN] = legend.CEILING_HEIGHT
    return heights


HEIGHTS = _heights()
"""Height in m of what stands on a cell of each shade; 0 for floor."""


@dataclass(frozen=True, eq=False)
class Surface:
    """What each pixel shows, arrays of shape (pixels,): the kind of surface, where it lies in the map frame (z up, m),
    how far away it is, the shade of its cell and of the floor before it, and whether it is the top of a thing."""

    kind: Numbers
    x: Floats32
    y: Floats32
    z: Floats32
    direction_x: Floats32
    distance: Floats32
    shade: Numbers
    floor_before: Numbers
    is_top: Mask

    def only(self, pixels: npt.NDArray[np.intp]) -> Surface:
        """These pixels of it."""
        return Surface(*(getattr(self, field.name).take(pixels) for field in fields(self)))


@dataclass(frozen=True, eq=False)
class Paint:
    """The number of each pixel's colour, and its brightness; 1 is the colour itself."""

    colour: Numbers
    light: Floats32


def paint(world: World, surface: Surface) -> Numbers:
    """RGB, shape (pixels, 3)."""
    colour, light = np.empty_like(surface.kind), np.empty_like(surface.distance)
    for kind, brush in ((SOLID, _solid), (FLOOR, _floor), (CEILING, _ceiling), (LINTEL, _lintel)):
        seen = np.flatnonzero(surface.kind == kind)
        if len(seen) > 0:
            part = brush(world, surface.only(seen))
            colour[seen], light[seen] = part.colour, part.light
    clear = np.exp(surface.distance / -HAZE_DISTANCE)
    light *= clear
    clear -= 1
    # A channel at a time is several times quicker than a pixel at a time.
    pixels = np.empty((len(colour), 3), dtype=np.uint8)
    for channel in range(3):
        value = _PALETTE[:, channel].take(colour)
        value *= light
        value -= HAZE[channel] * clear
        pixels[:, channel] = np.clip(value, 0, 255, out=value)
    return pixels


def _into(value: Floats32, period: float) -> Floats32:
    """How far a value lies beyond a multiple of `period`; `%` is ten times slower."""
    result: Floats32 = value - np.float32(period) * np.floor(value / period)
    return result


def _hash(a: Floats32, b: Floats32) -> Floats32:
    """A number from 0 to 1 that looks random and is the same for the same two whole numbers."""
    value = a.astype(np.int32).view(np.uint32) * np.uint32(0x9E3779B1)
    value ^= b.astype(np.int32).view(np.uint32) * np.uint32(0x85EBCA77)
    value ^= value >> np.uint32(15)
    value *= np.uint32(0x2C1B3C6D)
    value ^= value >> np.uint32(13)
    result: Floats32 = (value >> np.uint32(8)).astype(np.float32) / np.float32(2**24)
    return result


def _occlusion(world: World, s: Surface, reach: float, depth: float) -> Floats32:
    """Corners are darker: brightness by the distance to the next wall or piece of furniture."""
    clearance = world.grid.clearances(np.stack([s.x, s.y], axis=1))
    darker = 1 - np.clip(clearance / reach, 0, 1)
    result: Floats32 = 1 - depth * darker * darker
    return result


def _floor(world: World, s: Surface) -> Paint:
    light = _occlusion(world, s, 0.45, 0.42)
    for shade, pattern in _FLOOR_PATTERNS.items():
        seen = np.flatnonzero(s.shade == shade)
        if len(seen) > 0:
            light[seen] *= pattern(s.only(seen))
    return Paint(_FLOORS.take(s.shade), light)


def _wood(s: Surface) -> Floats32:
    plank = np.floor(s.y / 0.16)
    return 0.88 + 0.2 * _hash(plank, np.floor((s.x + plank * 0.37) / 1.2))


def _tiles(s: Surface) -> Floats32:
    joint = (_into(s.x, 0.5) < 0.016) | (_into(s.y, 0.5) < 0.016)
    return np.where(joint, np.float32(0.84), np.float32(1.0))


def _carpet(s: Surface) -> Floats32:
    tuft = 0.1 * _hash(np.floor(s.x / 0.03), np.floor(s.y / 0.03))
    return 0.95 + tuft * np.exp(s.distance / -3)


def _shine(s: Surface) -> Floats32:
    across = _into(s.x, 2.4) - 1.2
    result: Floats32 = 1 + 0.07 * np.exp(across * across * -4)
    return result


_FLOOR_PATTERNS: dict[int, Callable[[Surface], Floats32]] = {
    legend.WOOD: _wood,
    legend.TILES: _tiles,
    legend.CARPET: _carpet,
    legend.FLOOR: _shine,
}


def _ceiling(world: World, s: Surface) -> Paint:
    paint = Paint(np.full_like(s.kind, _CEILING), _occlusion(world, s, 0.6, 0.14))
    paint.colour[(_into(s.x, 0.6) < 0.015) | (_into(s.y, 0.6) < 0.015)] = _JOINT
    lamp = (np.abs(_into(s.x, 2.4) - 1.2) < 0.6) & (np.abs(_into(s.y - 1.0, 2.0) - 1.0) < 0.15)
    paint.colour[lamp] = _LAMP
    paint.light[lamp] = 1.0
    return paint


def _lintel(world: World, s: Surface) -> Paint:
    near = s.z < legend.LINTEL_HEIGHT + 0.07
    return Paint(np.where(near, np.uint8(_FRAME), np.uint8(_LINTEL)), np.ones_like(s.z))


def _solid(world: World, s: Surface) -> Paint:
    side = np.where(_IS_WALL.take(s.shade), _WALLS.take(s.floor_before), _SIDES.take(s.shade))
    facing = _faces_x(world, s)
    # Light comes from the ceiling, and the floor gives little back.
    light = np.where(facing, np.float32(0.86), np.float32(0.97)) * (0.86 + 0.14 * np.clip(s.z / 0.5, 0, 1))
    light[s.is_top] = 1.0
    paint = Paint(np.where(s.is_top, _TOPS.take(s.shade), side), light)
    along = np.where(facing, s.y, s.x)
    for shade, detail in _DETAILS:
        seen = np.flatnonzero(s.shade == shade)
        if len(seen) > 0:
            part = Paint(paint.colour.take(seen), paint.light.take(seen))
            detail(s.only(seen), along.take(seen), part)
            paint.colour[seen], paint.light[seen] = part.colour, part.light
    return paint


def _faces_x(world: World, s: Surface) -> Mask:
    """Whether the side that is seen faces along x: then a small step back along x alone leaves the thing."""
    grid = world.grid
    back = s.x - np.sign(s.direction_x) * grid.resolution
    column = np.clip(((back - grid.origin_x) / grid.resolution).astype(np.intp), 0, grid.width - 1)
    row = np.clip(((s.y - grid.origin_y) / grid.resolution).astype(np.intp), 0, grid.height - 1)
    before = world.shades.take(row * grid.width + column)
    result: Mask = HEIGHTS.take(before) < HEIGHTS.take(s.shade) - 0.01
    return result


# What follows paints over one shade of thing; `along` is the place along its side, in m.


def _wall(s: Surface, along: Floats32, paint: Paint) -> None:
    rail = (s.floor_before == legend.FLOOR) & (np.abs(s.z - 0.95) < 0.06)
    paint.colour[rail] = _RAIL
    tiled = (s.floor_before == legend.TILES) & (s.z < 1.6)
    paint.light[tiled] *= 0.98
    paint.light[tiled & (_into(s.z, 0.2) < 0.012)] *= 0.92
    paint.light[s.z < 0.09] *= 0.55


def _window(s: Surface, along: Floats32, paint: Paint) -> None:
    pane = (s.z > 0.95) & (s.z < 2.25)
    paint.light[pane] = 1.0
    paint.colour[pane] = _SKY
    hills = pane & (s.z < 1.28 + 0.07 * np.sin(along * 1.7) + 0.04 * np.sin(along * 4.1))
    paint.light[pane & ~hills] = 0.9 + 0.16 * (s.z[pane & ~hills] - 0.95) / 1.3
    paint.colour[hills] = _HILLS
    frame = pane & ((np.abs(_into(along, 1.1) - 0.55) > 0.52) | (s.z < 1.0) | (s.z > 2.2))
    paint.light[frame] = 1.0
    paint.colour[frame] = _WINDOW_FRAME


def _over_door(s: Surface, along: Floats32, paint: Paint) -> None:
    above = s.z > legend.LINTEL_HEIGHT + 0.07
    paint.light[above] = 1.0
    paint.colour[above] = _ABOVE_DOOR


def _table(s: Surface, along: Floats32, paint: Paint) -> None:
    """A board over dark legroom."""
    paint.light[~s.is_top & (s.z < 0.69)] *= 0.42


def _counter(s: Surface, along: Floats32, paint: Paint) -> None:
    paint.light[~s.is_top & (s.z < 0.1)] *= 0.4
    edge = ~s.is_top & (s.z > 0.96)
    paint.light[edge] = 1.0
    paint.colour[edge] = _WORKTOP


def _plant(s: Surface, along: Floats32, paint: Paint) -> None:
    """Leaves over a pot."""
    pot = s.z < 0.4
    leaves = 0.72 + 0.5 * _hash(np.floor((s.x - s.y) / 0.05), np.floor(s.z / 0.06))
    paint.light[:] = np.where(pot, np.float32(1.0), paint.light * leaves)
    paint.colour[pot] = _POT


def _dock(s: Surface, along: Floats32, paint: Paint) -> None:
    """A light around it."""
    light = np.abs(s.z - 0.4) < 0.03
    paint.light[light] = 1.0
    paint.colour[light] = _DOCK_LIGHT


def _shelf(s: Surface, along: Floats32, paint: Paint) -> None:
    level, height = np.floor(s.z / 0.36), _into(s.z, 0.36)
    book = np.floor(along / 0.05)
    row = ~s.is_top & (height > 0.03) & (s.z < 1.76)
    standing = row & (height < 0.2 + 0.1 * _hash(book, level)) & (_hash(level, book) > 0.12)
    pick = _hash(book[standing], level[standing] + 7) * len(_BOOKS)
    paint.colour[standing] = _BOOKS[pick.astype(np.intp)]
    paint.light[standing] = 0.9
    paint.light[row & ~standing] *= 0.45


_DETAILS: list[tuple[int, Callable[[Surface, Floats32, Paint], None]]] = [
    (legend.WALL, _wall),
    (legend.UNKNOWN, _wall),
    (legend.WINDOW, _wall),
    (legend.WINDOW, _window),
    (legend.FRAME, _over_door),
    (legend.DOOR, _over_door),
    (legend.TABLE, _table),
    (legend.COUNTER, _counter),
    (legend.PLANT, _plant),
    (legend.DOCK, _dock),
    (legend.SHELF, _shelf),
]
"""One after the other: of what is painted twice, the later lies over the earlier."""
