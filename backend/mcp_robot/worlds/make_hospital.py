"""Draws the world `hospital`, 100 x 60 m: run `python -m backend.mcp_robot.worlds.make_hospital` after a change.

Writes `hospital/map.png`, `map.yaml` and `places.yaml`, the same bytes every time; keep them. Two corridors run from
west to east, three links join them, rooms lie on both sides of each. Rooms at a link have a second door to it.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from pathlib import Path

from PIL import Image

from backend.mcp_robot.simulator import legend
from backend.mcp_robot.worlds.plan import YAML, Plan

WIDTH, DEPTH = 100.0, 60.0
WALL = 0.2  # its half is two cells: doors go right through
SOUTH, NORTH = (13.0, 16.0), (44.0, 47.0)
CORRIDORS = {"south corridor": SOUTH, "north corridor": NORTH}
"""The corridors lie between these, along x."""
LINKS = {"west link": (22.0, 25.0), "middle link": (48.5, 51.5), "east link": (75.0, 78.0)}
"""The links lie between these, along y."""
MIDDLE = 30.0
DOOR = 1.2
DEPARTMENTS = {
    "emergency": (0.0, 12.0), "radiology": (12.0, 22.0), "laboratory": (22.0, 31.0), "pharmacy": (31.0, 40.0),
    "lobby": (40.0, 60.0), "cafeteria": (60.0, 74.0), "kitchen": (74.0, 82.0), "chapel": (82.0, 90.0),
    "physiotherapy": (90.0, 100.0),
}  # fmt: skip
"""The rooms along the south wall, from west to east."""
BLOCKS = [[0.0, 11.0, 22.0], [25.0, 33.0, 41.0, 48.5], [51.5, 59.0, 67.0, 75.0], [78.0, 89.0, 100.0]]
"""Walls of the rooms between the links."""

FOLDER = Path(__file__).parent / "hospital"


@dataclass
class Hospital:
    """The plan, and the lines of places.yaml that describe it."""

    plan: Plan = field(default_factory=lambda: Plan(WIDTH, DEPTH, WALL))
    places: list[str] = field(default_factory=list)
    edges: list[str] = field(default_factory=list)
    doors: list[str] = field(default_factory=list)

    def place(self, name: str, x: float, y: float, yaw: float, *, kind: str = "space", sign: str = "") -> None:
        """Something that has a name."""
        position = f"position: {{x: {x:g}, y: {y:g}, yaw: {yaw:.2f}}}"
        self.places.append(f"  - {{id: {slug(name)}, name: {name}, type: {kind}, {position}{sign}}}")

    def edge(self, one: str, other: str) -> None:
        """A direct way between two places."""
        self.edges.append(f"  - [{slug(one)}, {slug(other)}]")

    def leaf(self, name: str, x0: float, y0: float, x1: float, y1: float) -> None:
        """A door that can be closed."""
        line = f"start: {{x: {x0:g}, y: {y0:g}}}, end: {{x: {x1:g}, y: {y1:g}}}"
        self.doors.append(f"  - {{id: {slug(name)}, {line}}}")

    def room(self, name: str, x: tuple[float, float], y: tuple[float, float], corridor: str, floor: int) -> None:
        """A room with a door to its corridor, which lies south or north of it, and to a link that it touches."""
        self.plan.room(x[0], y[0], x[1], y[1], floor)
        middle = (x[0] + x[1]) / 2
        south = y[0] >= CORRIDORS[corridor][1]  # where the corridor lies
        wall = y[0] if south else y[1]
        self.plan.door(middle, wall - WALL / 2, DOOR)
        self.leaf(name, middle - DOOR / 2, wall, middle + DOOR / 2, wall)
        beside = f", sign: {{x: {middle + 1.0:g}, y: {wall + (-0.1 if south else 0.1):g}}}"
        self.place(name, middle, wall + (3.0 if south else -3.0), math.pi / 2 * (1 if south else -1), sign=beside)
        self.edge(name, corridor)
        for link, (west, east) in LINKS.items():
            if SOUTH[1] <= y[0] < NORTH[0] and (x[0] == east or x[1] == west):
                at, along = (x[0] if x[0] == east else x[1]), (y[0] + y[1]) / 2
                self.plan.door_along_y(at - WALL / 2, along, DOOR)
                self.leaf(f"{name} {link}", at, along - DOOR / 2, at, along + DOOR / 2)
                self.edge(name, link)

    @property
    def yaml(self) -> str:
        """places.yaml."""
        head = "# Written by make_hospital.py. A door is closed by its id, in [robot.simulator]."
        parts = [head, "frame_id: map", "places:", *self.places, "edges:", *self.edges, "doors:", *self.doors]
        return "\n".join(parts) + "\n"


def slug(name: str) -> str:
    """An id."""
    return name.replace(" ", "-")


def build() -> Hospital:
    """The whole hospital."""
    hospital = Hospital()
    plan = hospital.plan
    plan.box(0, 0, WIDTH, DEPTH, legend.WALL)
    hospital.place("dock", 41.2, 2.0, 0.0, kind="docking")
    hospital.place("north dock", 1.2, sum(NORTH) / 2, 0.0, kind="docking")
    for name, (low, high) in CORRIDORS.items():
        plan.room(WALL / 2, low, WIDTH - WALL / 2, high, legend.FLOOR)
        hospital.place(name, 50.0, (low + high) / 2, 0.0)
    for name, (west, east) in LINKS.items():
        half = WALL / 2
        plan.box(west - half, SOUTH[1], east + half, NORTH[0], legend.WALL)
        plan.box(west + half, SOUTH[1] - half, east - half, NORTH[0] + half, legend.FLOOR)
        hospital.place(name, (west + east) / 2, MIDDLE, math.pi / 2)
        hospital.edge(name, "south corridor")
        hospital.edge(name, "north corridor")
    departments(hospital)
    wards(hospital)
    rooms(hospital)
    hospital.edge("dock", "lobby")
    hospital.edge("north dock", "north corridor")
    plan.box(WALL, sum(NORTH) / 2 - 0.3, 0.4, sum(NORTH) / 2 + 0.3, legend.DOCK)
    plan.box(40.0 + WALL / 2, 1.7, 40.5, 2.3, legend.DOCK)
    return hospital


def departments(hospital: Hospital) -> None:
    """Along the south wall."""
    plan = hospital.plan
    for index, (name, x) in enumerate(DEPARTMENTS.items()):
        floor = legend.WOOD if name == "lobby" else (legend.TILES, legend.CARPET)[index % 2]
        hospital.room(name, x, (WALL / 2, SOUTH[0]), "south corridor", floor)
        plan.box(x[0] + 1.0, 0, x[1] - 1.0, WALL, legend.WINDOW)
        if name == "lobby":
            plan.box(46.0, 4.0, 54.0, 5.0, legend.COUNTER)
            for seat in (43.0, 45.0, 55.0, 57.0):
                plan.box(seat, 8.0, seat + 0.8, 10.5, legend.BENCH)
        elif name == "cafeteria":
            for row in (2.5, 5.5):
                for column in (62.5, 66.0, 69.5, 72.0):
                    plan.disc(column, row, 0.6, legend.TABLE)
        else:
            plan.table((x[0] + x[1]) / 2, 2.5, (x[1] - x[0]) / 2, 1.0, chairs=3)
            plan.box(x[0] + 0.2, 5.0, x[0] + 0.8, 9.0, legend.SHELF)


def wards(hospital: Hospital) -> None:
    """Along the north wall: ten wards with beds."""
    for index in range(10):
        low, high = index * 10.0, (index + 1) * 10.0
        hospital.room(f"ward {index + 1}", (low, high), (NORTH[1], DEPTH - WALL / 2), "north corridor", legend.TILES)
        hospital.plan.box(low + 1.0, DEPTH - WALL, high - 1.0, DEPTH, legend.WINDOW)
        for bed in (1.2, 3.7, 6.2, 8.7):
            hospital.plan.box(low + bed - 0.5, DEPTH - 2.4, low + bed + 0.5, DEPTH - 0.4, legend.BENCH)
            hospital.plan.box(low + bed + 0.55, DEPTH - 0.9, low + bed + 0.95, DEPTH - 0.4, legend.TABLE)


def rooms(hospital: Hospital) -> None:
    """Between the corridors: twenty rooms, back to back."""
    number = 101
    for walls in BLOCKS:
        for x in itertools.pairwise(walls):
            for y, corridor in (((SOUTH[1], MIDDLE), "south corridor"), ((MIDDLE, NORTH[0]), "north corridor")):
                hospital.room(f"room {number}", x, y, corridor, legend.CARPET)
                back = MIDDLE - 1.2 if y[0] == SOUTH[1] else MIDDLE + 1.2
                hospital.plan.table((x[0] + x[1]) / 2, back, 3.0, 0.8)
                hospital.plan.disc(x[0] + 0.6, y[0] + 0.6, 0.25, legend.PLANT)
                hospital.plan.disc(x[1] - 0.6, y[1] - 0.6, 0.25, legend.PLANT)
                number += 1


def draw() -> Image.Image:
    """The whole plan."""
    return build().plan.image


def main() -> None:
    """Write the world's folder."""
    hospital = build()
    FOLDER.mkdir(exist_ok=True)
    hospital.plan.image.save(FOLDER / "map.png", optimize=True)
    (FOLDER / "map.yaml").write_text(YAML)
    (FOLDER / "places.yaml").write_text(hospital.yaml)


if __name__ == "__main__":
    main()
