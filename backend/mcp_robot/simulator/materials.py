"""How surfaces look: a colour for every pixel from where it lies in the building and what is there.

Plain functions over arrays of pixels; patterns are functions of the place, so that they stay put when the robot moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from backend.mcp_robot.grid import Floats
from backend.mcp_robot.simulator import shades
from backend.mcp_robot.simulator.world import World

SOLID, FLOOR, CEILING, LINTEL = range(4)

HAZE = np.array((206.0, 208.0, 206.0))
HAZE_DISTANCE = 26.0
SKY = np.array((190.0, 214.0, 236.0))
WALL_OF_FLOOR: dict[int, shades.Colour] = {
    shades.WOOD: (232, 216, 190),
    shades.TILES: (214, 224, 214),
    shades.CARPET: (224, 224, 216),
    shades.FLOOR: (230, 228, 220),
    shades.DOORWAY: (226, 222, 212),
}
BOOKS: Floats = np.array(
    [(148, 62, 54), (60, 92, 120), (196, 166, 92), (84, 110, 84), (120, 84, 110), (205, 200, 188)], dtype=float
)


def _table(colour_of: dict[int, shades.Colour], nearest_below: bool) -> Floats:
    keys = sorted(colour_of)
    rows = []
    for shade in range(256):
        if nearest_below:
            key = max((k for k in keys if k <= shade), default=keys[0])
        else:
            key = min(keys, key=lambda k: abs(k - shade))
        rows.append(colour_of[key])
    return np.array(rows, dtype=float)


_SIDES = _table({shade: thing.side for shade, thing in shades.THINGS.items()}, nearest_below=True)
_TOPS = _table({shade: thing.top for shade, thing in shades.THINGS.items()}, nearest_below=True)
_FLOORS = _table(shades.FLOORS, nearest_below=False)
_WALLS = _table(WALL_OF_FLOOR, nearest_below=False)


def _heights() -> Floats:
    heights = np.zeros(256)
    for shade in range(shades.UNKNOWN):
        heights[shade] = shades.thing(shade).height
    heights[shades.UNKNOWN] = shades.CEILING_HEIGHT
    return heights


HEIGHTS = _heights()
"""Height in m of what stands on a cell of each shade; 0 for floor."""


@dataclass(frozen=True, eq=False)
class Surface:
    """What each pixel shows, arrays of one shape: the kind of surface, where it lies in the map frame (z up, m), how
    far away it is, the shade of its cell and of the floor before it, and whether it is the top of a thing."""

    kind: npt.NDArray[np.uint8]
    x: Floats
    y: Floats
    z: Floats
    direction_x: Floats
    distance: Floats
    shade: npt.NDArray[np.uint8]
    floor_before: npt.NDArray[np.uint8]
    is_top: npt.NDArray[np.bool_]


def paint(world: World, surface: Surface) -> npt.NDArray[np.uint8]:
    """RGB pixels, shape (height, width, 3)."""
    colour: Floats = np.empty((*surface.kind.shape, 3))
    for kind, brush in ((SOLID, _solid), (FLOOR, _floor), (CEILING, _ceiling), (LINTEL, _lintel)):
        mask = surface.kind == kind
        if mask.any():
            colour[mask] = brush(world, _only(surface, mask))
    haze = np.exp(-surface.distance / HAZE_DISTANCE)[..., None]
    colour = np.clip(colour * haze + HAZE * (1 - haze), 0, 255)
    pixels: npt.NDArray[np.uint8] = colour.astype(np.uint8)
    return pixels


def _only(s: Surface, mask: npt.NDArray[np.bool_]) -> Surface:
    return Surface(*(getattr(s, name)[mask] for name in Surface.__dataclass_fields__))


def _hash(a: Floats, b: Floats) -> Floats:
    """A number from 0 to 1 that looks random and is the same for the same place."""
    value = np.sin(a * 12.9898 + b * 78.233) * 43758.5453
    result: Floats = value - np.floor(value)
    return result


def _occlusion(world: World, s: Surface, reach: float, depth: float) -> Floats:
    """Corners are darker: brightness by the distance to the next wall or piece of furniture."""
    grid = world.grid
    points = np.stack([s.x, s.y], axis=1)
    return 1 - depth * (1 - np.clip(grid.clearances(points) / reach, 0, 1)) ** 2


def _floor(world: World, s: Surface) -> Floats:
    colour = _FLOORS[s.shade]
    plank = np.floor(s.y / 0.16)
    wood = 0.88 + 0.2 * _hash(plank, np.floor((s.x + plank * 0.37) / 1.2))
    tiles = np.where((s.x % 0.5 < 0.016) | (s.y % 0.5 < 0.016), 0.84, 1.0)
    carpet = 0.95 + 0.1 * _hash(np.floor(s.x / 0.03), np.floor(s.y / 0.03)) * np.exp(-s.distance / 3)
    shine = 1 + 0.07 * np.exp(-(((s.x % 2.4) - 1.2) ** 2) / 0.25)
    pattern = np.select(
        [s.shade == shades.WOOD, s.shade == shades.TILES, s.shade == shades.CARPET, s.shade == shades.FLOOR],
        [wood, tiles, carpet, shine],
        1.0,
    )
    return colour * (pattern * _occlusion(world, s, 0.45, 0.42))[:, None]


def _ceiling(world: World, s: Surface) -> Floats:
    colour = np.full((len(s.x), 3), 236.0)
    joint = (s.x % 0.6 < 0.015) | (s.y % 0.6 < 0.015)
    colour[joint] = 218.0
    lamp = (np.abs(s.x % 2.4 - 1.2) < 0.6) & (np.abs((s.y - 1.0) % 2.0 - 1.0) < 0.15)
    colour *= _occlusion(world, s, 0.6, 0.14)[:, None]
    colour[lamp] = (255.0, 254.0, 246.0)
    return colour


def _lintel(world: World, s: Surface) -> Floats:
    colour: Floats = np.tile((218.0, 215.0, 206.0), (len(s.x), 1))
    colour[s.z < shades.LINTEL_HEIGHT + 0.07] = shades.THINGS[shades.FRAME].side
    return colour


def _solid(world: World, s: Surface) -> Floats:
    side = np.where(_is_wall(s.shade)[:, None], _WALLS[s.floor_before], _SIDES[s.shade])
    colour: Floats = np.where(s.is_top[:, None], _TOPS[s.shade], side)
    facing = _faces_x(world, s)
    light = np.where(s.is_top, 1.0, np.where(facing, 0.86, 0.97))
    # Light comes from the ceiling, and the floor gives little back.
    light *= np.where(s.is_top, 1.0, 0.86 + 0.14 * np.clip(s.z / 0.5, 0, 1))
    colour = colour * light[:, None]
    _wall_details(s, colour)
    _window(s, colour, np.where(facing, s.y, s.x))
    _shelf(s, colour, np.where(facing, s.y, s.x))
    _furniture(s, colour)
    return colour


def _is_wall(shade: npt.NDArray[np.uint8]) -> npt.NDArray[np.bool_]:
    wall: npt.NDArray[np.bool_] = np.isin(shade, (shades.WALL, shades.WINDOW, shades.UNKNOWN))
    return wall


def _faces_x(world: World, s: Surface) -> npt.NDArray[np.bool_]:
    """Whether the side that is seen faces along x: then a small step back along x alone leaves the thing."""
    grid = world.grid
    back = s.x - np.sign(s.direction_x) * grid.resolution
    column = np.clip(((back - grid.origin_x) / grid.resolution).astype(np.intp), 0, grid.width - 1)
    row = np.clip(((s.y - grid.origin_y) / grid.resolution).astype(np.intp), 0, grid.height - 1)
    result: npt.NDArray[np.bool_] = HEIGHTS[world.shades[row, column]] < HEIGHTS[s.shade] - 0.01
    return result


def _wall_details(s: Surface, colour: Floats) -> None:
    wall = _is_wall(s.shade)
    rail = wall & (s.floor_before == shades.FLOOR) & (np.abs(s.z - 0.95) < 0.06)
    colour[rail] = (92, 132, 146)
    tiled = wall & (s.floor_before == shades.TILES) & (s.z < 1.6)
    colour[tiled] *= np.where(((s.z[tiled] % 0.2) < 0.012), 0.9, 0.98)[:, None]
    colour[wall & (s.z < 0.09)] *= 0.55
    above_door = np.isin(s.shade, (shades.FRAME, shades.DOOR)) & (s.z > shades.LINTEL_HEIGHT + 0.07)
    colour[above_door] = (222, 219, 210)


def _window(s: Surface, colour: Floats, along: Floats) -> None:
    pane = (s.shade == shades.WINDOW) & (s.z > 0.95) & (s.z < 2.25)
    frame = pane & ((np.abs(along % 1.1 - 0.55) > 0.52) | (s.z < 1.0) | (s.z > 2.2))
    brightness = 0.9 + 0.16 * np.clip((s.z[pane] - 0.95) / 1.3, 0, 1)
    colour[pane] = SKY * brightness[:, None]
    hills = pane & (s.z < 1.28 + 0.07 * np.sin(along * 1.7) + 0.04 * np.sin(along * 4.1))
    colour[hills] = (146, 172, 138)
    colour[frame] = (240, 240, 238)


def _furniture(s: Surface, colour: Floats) -> None:
    """Tables have a board over dark legroom, plants a pot under their leaves, the dock a light."""
    colour[(s.shade == shades.TABLE) & ~s.is_top & (s.z < 0.69)] *= 0.42
    colour[(s.shade == shades.COUNTER) & ~s.is_top & (s.z < 0.1)] *= 0.4
    colour[(s.shade == shades.COUNTER) & ~s.is_top & (s.z > 0.96)] = shades.THINGS[shades.COUNTER].top
    plant = s.shade == shades.PLANT
    colour[plant] *= (0.72 + 0.5 * _hash(np.floor((s.x - s.y) / 0.05), np.floor(s.z / 0.06)))[plant, None]
    colour[plant & (s.z < 0.4)] = (158, 98, 72)
    colour[(s.shade == shades.DOCK) & (np.abs(s.z - 0.4) < 0.03)] = (90, 220, 140)


def _shelf(s: Surface, colour: Floats, along: Floats) -> None:
    shelf = (s.shade == shades.SHELF) & ~s.is_top
    level = np.floor(s.z / 0.36)
    book = np.floor(along / 0.05)
    tall = 0.2 + 0.1 * _hash(book, level)
    in_row = shelf & ((s.z % 0.36) < tall) & ((s.z % 0.36) > 0.03) & (s.z < 1.76) & (_hash(level, book) > 0.12)
    pick = (_hash(book, level + 7) * len(BOOKS)).astype(np.intp)
    colour[in_row] = BOOKS[pick[in_row]] * 0.9
    gap = shelf & ~in_row & ((s.z % 0.36) > 0.03) & (s.z < 1.76)
    colour[gap] *= 0.45
