"""Loads a world from a folder: a map in ROS map_server format, `places.yaml` with named places, and `keep_out.yaml`.

The folder is outside input: it is checked here once, and an error names the file, the field and the reason. A world
never changes; closing a door makes another world. Nothing is written.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Self

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from backend.config import KeepOut
from backend.mcp_robot.motion import safety
from backend.mcp_robot.navigation import named_places
from backend.mcp_robot.navigation.grid import FREE, Floats, OccupancyGrid, sample
from backend.mcp_robot.robot import PlaceKind, TopologicalMap
from backend.mcp_robot.simulator import legend, map_file, yaml_file
from backend.mcp_robot.simulator.map_file import Coordinate, Number
from backend.mcp_robot.simulator.yaml_file import WorldError as WorldError
from backend.telemetry import Place, Pose, Zone

BUILT_IN = Path(__file__).parent.parent / "worlds"
FOOTPRINT_RADIUS = 0.25
"""Radius of the simulated robot, in m."""
START_ROOM = 0.5
"""A robot on a map without places begins where it has so much room (m), if there is any."""
MAX_PLACES, MAX_EDGES, MAX_ZONES = 1000, 10_000, 200
"""The most places, edges and doors of a `places.yaml`, and zones of a `keep_out.yaml`."""
MAX_YAW = 6.3
"""rad: a whole turn. A larger yaw is one in degrees."""
SHOWN = 8
"""Mistakes that one error lists."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Sign:
    """The name of a place on a wall, in the map frame."""

    text: str
    x: float
    y: float


@dataclass(frozen=True)
class Door:
    """A door that can be closed: the line in the map frame, in m, where its leaf then stands."""

    id: str
    start: tuple[float, float]
    end: tuple[float, float]

    def distance(self, x: float, y: float) -> float:
        """m from a point to the leaf."""
        return float(np.hypot(*(sample(self.start, self.end, 0.05) - (x, y)).T).min())


@dataclass(frozen=True, eq=False)
class World:
    """The map, names and doors that the simulator uses. `shades` is the map's picture, row 0 at the bottom, dark is
    occupied (legend.py). `doors` are open, except those that `with_closed` has made part of the walls."""

    grid: OccupancyGrid
    shades: npt.NDArray[np.uint8]
    places: TopologicalMap
    signs: tuple[Sign, ...] = ()
    doors: tuple[Door, ...] = ()
    zones: tuple[Zone, ...] = ()

    @property
    def start(self) -> Pose:
        """Where the robot begins: at the first dock, else at the first place, else as near to the map's origin, where
        mapping usually began, as there is room."""
        docks = [place for place in self.places.places if place.kind == "docking"]
        named = docks or list(self.places.places)
        return named[0].pose if named else _roomy(self.grid)

    def door(self, name: str) -> Door:
        """The door with this id. Raises `WorldError`."""
        for door in self.doors:
            if door.id == name:
                return door
        names = ", ".join(door.id for door in self.doors) or "none"
        raise WorldError(f"There is no door {name!r} in this world. Its doors: {names}.")

    def with_closed(self, ids: Collection[str]) -> World:
        """The world with these doors closed. Raises `WorldError` for an id that no door has."""
        if not ids:
            return self
        leaves = np.concatenate([self._leaf(self.door(name)) for name in ids])
        picture = self.shades.copy()
        for x, y in leaves.tolist():
            cell = self.grid.cell(x, y)
            if cell is not None:
                picture[cell] = legend.DOOR
        picture.flags.writeable = False
        return replace(self, grid=self.grid.with_occupied(leaves), shades=picture)

    def _leaf(self, door: Door) -> Floats:
        """Points of which every cell that the leaf crosses has one, also where the leaf lies diagonally."""
        half = self.grid.resolution / 2
        (x0, y0), (x1, y1) = door.start, door.end
        return np.concatenate(
            [sample((x0 + d, y0 + e), (x1 + d, y1 + e), half) for d, e in ((-half, -half), (0, 0), (half, half))]
        )


def _roomy(grid: OccupancyGrid) -> Pose:
    """The point nearest to the map frame's origin that has room for a robot; the roomiest when none has."""
    enough = min(START_ROOM, float(grid.distance.max()))
    rows, columns = np.nonzero(grid.distance >= enough)
    x = grid.origin_x + (columns + 0.5) * grid.resolution
    y = grid.origin_y + (rows + 0.5) * grid.resolution
    nearest = int(np.argmin(np.hypot(x, y)))
    return Pose(float(x[nearest]), float(y[nearest]), 0.0)


class _Point(BaseModel):
    model_config = ConfigDict(extra="forbid")
    x: Coordinate
    y: Coordinate


class _Position(_Point):
    yaw: Annotated[Number, Field(ge=-MAX_YAW, le=MAX_YAW)] = 0.0


def _one_line(name: str) -> str:
    if not named_places.is_readable(name):
        raise ValueError("must have a letter or a digit, and no invisible characters")
    return name


Name = Annotated[str, Field(min_length=1, max_length=80), AfterValidator(_one_line)]


class _Place(BaseModel):
    model_config = ConfigDict(extra="forbid")
    id: Name
    name: Name
    type: PlaceKind = "space"
    position: _Position
    sign: _Point | None = None


class _Door(BaseModel):
    model_config = ConfigDict(extra="forbid")
    id: Name
    start: _Point
    end: _Point


class _KeepOutYaml(BaseModel):
    model_config = ConfigDict(extra="forbid")
    zones: Annotated[list[KeepOut], Field(max_length=MAX_ZONES)]


class _PlacesYaml(BaseModel):
    model_config = ConfigDict(extra="forbid")
    frame_id: Name = "map"
    places: Annotated[list[_Place], Field(min_length=1, max_length=MAX_PLACES)]
    edges: Annotated[list[tuple[str, str]], Field(max_length=MAX_EDGES)] = []
    doors: Annotated[list[_Door], Field(max_length=MAX_EDGES)] = []

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for kind, names in (("places", [p.id for p in self.places]), ("doors", [d.id for d in self.doors])):
            twice = [name for name, times in Counter(names).items() if times > 1]
            if twice:
                raise ValueError(f"{kind}: {twice[0]!r} is there twice")
        alike = named_places.alike([(p.id, p.name) for p in self.places])
        if alike:
            first, second = (f"{self.places[index].name} ({self.places[index].id})" for index in alike)
            raise ValueError(f"places: people could not tell {first} from {second} by name or id; rename one of them")
        known = {p.id for p in self.places}
        for edge in self.edges:
            for end in edge:
                if end not in known:
                    raise ValueError(f"edges: there is no place with the id {end[:80]!r}")
        return self


def load(world: str) -> World:
    """Load a built-in world by its name, or any by the path of its map.yaml or the folder with it. Raises `WorldError`.

    A ROS map needs no `places.yaml`: without one the robot knows no names, and drives to poses only.
    """
    file = _map_of(world)
    grid, picture = map_file.load(file)
    if not (grid.cells == FREE).any():
        raise WorldError(f"{file}: the map has no free cell; look at negate and free_thresh.")
    unnamed = World(grid, picture, TopologicalMap("map", (), ()), zones=_keep_out(file.parent / "keep_out.yaml"))
    named = file.parent / "places.yaml"
    if yaml_file.is_there(named):
        return _with_names(unnamed, named)
    start = unnamed.start
    if grid.clearance(start.x, start.y) < FOOTPRINT_RADIUS:
        room = f"{FOOTPRINT_RADIUS:g} m around its centre"
        raise WorldError(f"{file}: no free floor has room for the robot, {room}; look at resolution and free_thresh.")
    logger.warning("%s is missing: the robot knows no places by name, and drives to poses only.", named)
    return unnamed


def _map_of(world: str) -> Path:
    """The map.yaml that is meant. Raises `WorldError`."""
    built_in = sorted(path.name for path in BUILT_IN.iterdir() if (path / "map.yaml").is_file())
    try:
        path = BUILT_IN / world if world in built_in else Path(world).expanduser()
        file = path / "map.yaml" if path.is_dir() else path
        if file.is_file():
            return file
    except (OSError, RuntimeError, ValueError) as error:  # a folder that may not be read, no such user, no such name
        reason = error.strerror if isinstance(error, OSError) else error
        raise WorldError(f"The world {world[:200]!r} cannot be read: {reason}.") from None
    names = ", ".join(built_in)
    raise WorldError(
        f"There is no world {world[:200]!r}: neither built in ({names}) nor a map.yaml or a folder with one."
    )


def _keep_out(file: Path) -> tuple[Zone, ...]:
    if not yaml_file.is_there(file):
        return ()
    return tuple(Zone(zone.name, zone.polygon) for zone in yaml_file.read(file, _KeepOutYaml).zones)


def names(path: str) -> TopologicalMap:
    """The places of a `places.yaml`, for a robot that has its map from elsewhere. Raises `WorldError`."""
    try:
        file = Path(path).expanduser()
    except RuntimeError as error:  # there is no such user
        raise WorldError(f"{path} cannot be read: {error}") from None
    return _places(yaml_file.read(file, _PlacesYaml))


def _places(data: _PlacesYaml) -> TopologicalMap:
    places = tuple(Place(p.id, p.name, p.type, Pose(p.position.x, p.position.y, p.position.yaw)) for p in data.places)
    return TopologicalMap(data.frame_id, places, tuple(data.edges))


def _with_names(world: World, file: Path) -> World:
    data = yaml_file.read(file, _PlacesYaml)
    mistakes = list(_misplaced(world.grid, data))
    if mistakes:
        more = [f"and {len(mistakes) - SHOWN} more"] if len(mistakes) > SHOWN else []
        raise WorldError("\n  ".join([f"{file} does not fit its map:", *mistakes[:SHOWN], *more]))
    return replace(
        world,
        places=_places(data),
        signs=tuple(Sign(p.name, p.sign.x, p.sign.y) for p in data.places if p.sign),
        doors=tuple(Door(d.id, (d.start.x, d.start.y), (d.end.x, d.end.y)) for d in data.doors),
    )


def _misplaced(grid: OccupancyGrid, data: _PlacesYaml) -> Iterator[str]:
    """A sentence on each place or door that cannot be where it is said to be."""
    for place in data.places:
        mistake = safety.misplaced(grid, place.position.x, place.position.y, FOOTPRINT_RADIUS)
        if mistake:
            yield f"{place.name} {mistake}"
    for door in data.doors:
        ends = [(end.x, end.y) for end in (door.start, door.end)]
        middle = (door.start.x + door.end.x) / 2, (door.start.y + door.end.y) / 2
        for x, y in (*ends, middle):
            state = grid.state(x, y)
            if state is None:
                yield f"door {door.id} ({x:g}, {y:g}) is outside the map ({grid.extent})."
            elif (x, y) == middle and state != FREE:
                yield f"door {door.id} ({x:g}, {y:g}) is not on free floor."
