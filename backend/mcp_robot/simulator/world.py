"""Loads a world from a folder: a map in ROS map_server format, `places.yaml` with named places, and `keep_out.yaml`.

The folder is outside input: it is checked here once, and an error names the file, the field and the reason. A world
never changes; closing a door makes another world. Nothing is written.
"""

from __future__ import annotations

import logging
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Self

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, model_validator

from backend.config import KeepOut
from backend.mcp_robot.navigation.grid import FREE, Floats, OccupancyGrid, sample
from backend.mcp_robot.robot import PlaceKind, TopologicalMap
from backend.mcp_robot.simulator import legend, map_file
from backend.mcp_robot.simulator.map_file import WorldError as WorldError
from backend.telemetry import Place, Pose, Zone

BUILT_IN = Path(__file__).parent.parent / "worlds"
START_ROOM = 0.5
"""A robot on a map without places begins where it has so much room (m), if there is any."""

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
    x: FiniteFloat
    y: FiniteFloat


class _Position(_Point):
    yaw: FiniteFloat = 0.0


Name = Annotated[str, Field(min_length=1, max_length=80)]


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
    zones: list[KeepOut]


class _PlacesYaml(BaseModel):
    model_config = ConfigDict(extra="forbid")
    frame_id: str = "map"
    places: Annotated[list[_Place], Field(min_length=1)]
    edges: list[tuple[str, str]] = []
    doors: list[_Door] = []

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for kind, names in (
            ("places", [p.id for p in self.places]),
            ("places", [p.name.casefold() for p in self.places]),
            ("doors", [d.id for d in self.doors]),
        ):
            twice = {name for name in names if names.count(name) > 1}
            if twice:
                raise ValueError(f"{kind}: {sorted(twice)[0]!r} is there twice")
        known = {p.id for p in self.places}
        for edge in self.edges:
            for end in edge:
                if end not in known:
                    raise ValueError(f"edges: there is no place with the id {end!r}")
        return self


def load(world: str) -> World:
    """Load a built-in world by its name, or any by the path of its map.yaml or the folder with it. Raises `WorldError`.

    A ROS map needs no `places.yaml`: without one the robot knows no names, and drives to poses only.
    """
    built_in = sorted(path.name for path in BUILT_IN.iterdir() if (path / "map.yaml").is_file())
    path = BUILT_IN / world if world in built_in else Path(world).expanduser()
    file = path / "map.yaml" if path.is_dir() else path
    if not file.is_file():
        names = ", ".join(built_in)
        raise WorldError(
            f"There is no world {world!r}: neither built in ({names}) nor a map.yaml or a folder with one."
        )
    grid, picture = map_file.load(file)
    if not (grid.cells == FREE).any():
        raise WorldError(f"{file}: the map has no free cell; look at negate and free_thresh.")
    unnamed = World(grid, picture, TopologicalMap("map", (), ()), zones=_keep_out(file.parent / "keep_out.yaml"))
    named = file.parent / "places.yaml"
    if not named.is_file():
        logger.warning("%s is missing: the robot knows no places by name, and drives to poses only.", named)
        return unnamed
    return _with_names(unnamed, named)


def _keep_out(file: Path) -> tuple[Zone, ...]:
    if not file.is_file():
        return ()
    return tuple(Zone(zone.name, zone.polygon) for zone in map_file.read(file, _KeepOutYaml).zones)


def names(file: Path) -> TopologicalMap:
    """The places of a `places.yaml`, for a robot that has its map from elsewhere. Raises `WorldError`."""
    return _places(map_file.read(file, _PlacesYaml))


def _places(data: _PlacesYaml) -> TopologicalMap:
    places = tuple(Place(p.id, p.name, p.type, Pose(p.position.x, p.position.y, p.position.yaw)) for p in data.places)
    return TopologicalMap(data.frame_id, places, tuple(data.edges))


def _with_names(world: World, file: Path) -> World:
    data = map_file.read(file, _PlacesYaml)
    points = [(p.name, p.position.x, p.position.y) for p in data.places]
    points += [(f"door {d.id}", (d.start.x + d.end.x) / 2, (d.start.y + d.end.y) / 2) for d in data.doors]
    for name, x, y in points:
        if world.grid.state(x, y) != FREE:
            raise WorldError(f"{file}: {name} ({x:g}, {y:g}) is not on free floor.")
    return replace(
        world,
        places=_places(data),
        signs=tuple(Sign(p.name, p.sign.x, p.sign.y) for p in data.places if p.sign),
        doors=tuple(Door(d.id, (d.start.x, d.start.y), (d.end.x, d.end.y)) for d in data.doors),
    )
