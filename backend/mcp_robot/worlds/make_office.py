"""Draws the world `office`: run `python -m backend.mcp_robot.worlds.make_office` after a change, and keep its output.

Writes `office/map.png` and `office/map.yaml`, the same bytes every time; `office/places.yaml` is written by hand.
"""

from __future__ import annotations

import itertools
from pathlib import Path

from PIL import Image

from backend.mcp_robot.simulator import legend
from backend.mcp_robot.worlds.plan import YAML, Plan

WIDTH, DEPTH = 24.0, 14.0
WALL = 0.15
SOUTH, NORTH = 6.0, 8.0
"""The corridor lies between these."""
NORTH_WALLS = [5.0, 8.8, 12.6, 16.4, 20.2]
SOUTH_WALLS = [5.6, 10.2, 14.8, 19.4]

FOLDER = Path(__file__).parent / "office"


def building(plan: Plan) -> None:
    """Floors, walls, windows and doors."""
    plan.box(0, 0, WIDTH, DEPTH, legend.WALL)
    plan.box(WALL, WALL, WIDTH - WALL, SOUTH - WALL, legend.CARPET)
    plan.box(WALL, NORTH + WALL, WIDTH - WALL, DEPTH - WALL, legend.CARPET)
    plan.box(WALL, SOUTH, WIDTH - WALL, NORTH, legend.FLOOR)
    plan.box(WALL, WALL, SOUTH_WALLS[0], SOUTH - WALL, legend.WOOD)
    plan.box(WALL, NORTH + WALL, NORTH_WALLS[0], DEPTH - WALL, legend.TILES)
    for x in SOUTH_WALLS:
        plan.box(x - WALL / 2, 0, x + WALL / 2, SOUTH, legend.WALL)
    for x in NORTH_WALLS:
        plan.box(x - WALL / 2, NORTH, x + WALL / 2, DEPTH, legend.WALL)
    for low, high in rooms(NORTH_WALLS):
        plan.box(low + 0.6, DEPTH - WALL, high - 0.6, DEPTH, legend.WINDOW)
    for low, high in rooms(SOUTH_WALLS):
        plan.box(low + 0.6, 0, high - 0.6, WALL, legend.WINDOW)
    plan.box(WIDTH - WALL, SOUTH + 0.4, WIDTH, NORTH - 0.4, legend.WINDOW)
    plan.door(3.9, SOUTH - WALL, 2.0)  # reception
    plan.door(3.2, NORTH, 1.2)  # kitchen
    for x in (6.2, 10.0, 13.8, 17.6, 21.4):
        plan.door(x, NORTH)
    for x in (7.0, 11.6, 16.2, 20.8):
        plan.door(x, SOUTH - WALL)


def rooms(walls: list[float]) -> list[tuple[float, float]]:
    """From wall to wall, west to east."""
    edges = [0.0, *walls, WIDTH]
    return list(itertools.pairwise(edges))


def furnish(plan: Plan) -> None:
    """Enough furniture to look like an office, none in the way of the doors."""
    for index, (low, high) in enumerate(rooms(NORTH_WALLS)[1:]):  # labs 2.3.1 to 2.3.5
        middle = (low + high) / 2
        plan.table(middle, DEPTH - 1.0, high - low - 1.4, 0.7, chairs=2)
        plan.box(high - 0.5, 9.6, high - WALL / 2, 11.6, legend.SHELF)
        if index % 2:
            plan.disc(low + 0.45, NORTH + 0.65, 0.22, legend.PLANT)
    for index, (low, high) in enumerate(rooms(SOUTH_WALLS)[1:]):  # labs 2.3.6 to 2.3.9
        middle = (low + high) / 2
        plan.table(middle + 0.9, 3.2, 1.8, 0.9, chairs=2)
        plan.box(low + 0.6, WALL, high - 0.6, 0.75, legend.TABLE)
        plan.box(high - 0.5, 4.2, high - WALL / 2, 5.6, legend.SHELF)
        if index % 2 == 0:
            plan.disc(low + 0.5, 1.4, 0.22, legend.PLANT)
    kitchen(plan)
    reception(plan)
    plan.box(23.3, NORTH - 0.35, 23.8, NORTH, legend.SHELF)  # the corridor's printer
    plan.box(14.9, NORTH - 0.32, 16.3, NORTH, legend.BENCH)


def kitchen(plan: Plan) -> None:
    """A counter along two walls and two round tables."""
    plan.box(WALL, DEPTH - 0.75, 4.2, DEPTH - WALL, legend.COUNTER)
    plan.box(WALL, 11.2, 0.75, DEPTH - WALL, legend.COUNTER)
    for x, y in ((1.5, 9.6), (3.6, 11.3)):
        plan.disc(x, y, 0.5, legend.TABLE)
        for dx, dy in ((0.68, 0.0), (-0.68, 0.0)):
            plan.disc(x + dx, y + dy, 0.18, legend.CHAIR)


def reception(plan: Plan) -> None:
    """A desk, a sofa, a plant, and the dock's base against the west wall."""
    plan.box(1.3, 4.2, 2.1, 5.2, legend.COUNTER)
    plan.box(2.1, 4.2, 2.5, 4.5, legend.COUNTER)
    plan.box(4.6, 0.5, 5.3, 2.4, legend.BENCH)
    plan.disc(5.1, 3.1, 0.25, legend.PLANT)
    plan.box(1.6, 0.2, 3.4, 0.6, legend.SHELF)
    plan.box(WALL, 2.8, 0.35, 3.4, legend.DOCK)


def draw() -> Image.Image:
    """The whole plan."""
    plan = Plan(WIDTH, DEPTH, WALL)
    building(plan)
    furnish(plan)
    return plan.image


def main() -> None:
    """Write the world's folder."""
    FOLDER.mkdir(exist_ok=True)
    draw().save(FOLDER / "map.png", optimize=True)
    (FOLDER / "map.yaml").write_text(YAML)


if __name__ == "__main__":
    main()
