"""The legend of a map's picture: which thing each shade of grey stands for.

The shades only refine ROS's three classes free, occupied and unknown, so that every ROS tool reads the same map; a
plain map has black walls and white floor. Only the simulated camera uses the legend. Nothing may plan by it.
"""

from __future__ import annotations

from dataclasses import dataclass

Colour = tuple[int, int, int]

# Occupied: the darker, the taller.
WALL = 0
FRAME = 4
WINDOW = 8
DOOR = 12
SHELF = 20
PLANT = 30
COUNTER = 40
DOCK = 50
CHAIR = 60
TABLE = 70
BENCH = 80

UNKNOWN = 205

# Free.
WOOD = 225
TILES = 235
CARPET = 245
DOORWAY = 250
FLOOR = 254

CEILING_HEIGHT = 2.7
LINTEL_HEIGHT = 2.1


@dataclass(frozen=True)
class Thing:
    """The looks of a thing: `height` in m, the colour of its sides and of its top."""

    height: float
    side: Colour
    top: Colour


THINGS: dict[int, Thing] = {
    WALL: Thing(CEILING_HEIGHT, (226, 222, 212), (226, 222, 212)),
    FRAME: Thing(CEILING_HEIGHT, (70, 104, 128), (70, 104, 128)),
    WINDOW: Thing(CEILING_HEIGHT, (226, 222, 212), (226, 222, 212)),
    DOOR: Thing(CEILING_HEIGHT, (150, 104, 70), (150, 104, 70)),
    SHELF: Thing(1.8, (150, 116, 84), (168, 134, 100)),
    PLANT: Thing(1.3, (74, 122, 70), (94, 146, 84)),
    COUNTER: Thing(1.0, (206, 210, 208), (92, 94, 98)),
    DOCK: Thing(0.5, (48, 52, 58), (70, 190, 120)),
    CHAIR: Thing(0.85, (58, 66, 78), (72, 82, 96)),
    TABLE: Thing(0.74, (164, 132, 96), (206, 176, 136)),
    BENCH: Thing(0.45, (96, 112, 134), (120, 138, 162)),
}

FLOORS: dict[int, Colour] = {
    WOOD: (168, 130, 92),
    TILES: (196, 190, 178),
    CARPET: (112, 124, 138),
    DOORWAY: (120, 112, 104),
    FLOOR: (176, 178, 176),
}


def thing(shade: int) -> Thing:
    """The thing of the nearest known shade that is not lighter."""
    return THINGS[max(known for known in THINGS if known <= shade)]


def floor(shade: int) -> Colour:
    """The colour of the floor with the nearest known shade."""
    return FLOORS[min(FLOORS, key=lambda known: abs(known - shade))]
