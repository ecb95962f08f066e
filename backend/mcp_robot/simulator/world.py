"""A world from a folder: a map in ROS map_server format (`map.yaml` and its picture) and `places.yaml`.

The folder is outside input: it is checked here once, and a mistake is told with the file, the field and what is
wrong. Nothing is written.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
import numpy.typing as npt
import yaml
from PIL import Image, UnidentifiedImageError
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, model_validator

from backend.mcp_robot.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from backend.mcp_robot.robot import PlaceKind, TopologicalMap
from backend.telemetry import Place, Pose

BUILT_IN = Path(__file__).parent.parent / "worlds"
Model = TypeVar("Model", bound=BaseModel)

MAX_CELLS = 64_000_000
MIDDLE_GREY = 205
"""The shade that map_saver gives to unknown cells."""


class WorldError(Exception):
    """A world that cannot be used; the text says which file and what is wrong with it."""


@dataclass(frozen=True, eq=False)
class Sign:
    """The name of a place on a wall, in the map frame."""

    text: str
    x: float
    y: float


@dataclass(frozen=True, eq=False)
class World:
    """What the simulator moves in. `shades` is the map's picture, row 0 at the bottom, dark is occupied."""

    grid: OccupancyGrid
    shades: npt.NDArray[np.uint8]
    places: TopologicalMap
    signs: tuple[Sign, ...]

    @property
    def start(self) -> Pose:
        """Where a robot that was just switched on stands: at the first dock, else at the first place."""
        docks = [place for place in self.places.places if place.kind == "docking"]
        return (docks or list(self.places.places))[0].pose


class _MapYaml(BaseModel):
    """The fields that ROS 2's map_server reads."""

    model_config = ConfigDict(extra="allow")

    image: str
    resolution: Annotated[FiniteFloat, Field(gt=0, le=5)]
    origin: tuple[FiniteFloat, FiniteFloat, FiniteFloat]
    negate: bool = False
    occupied_thresh: Annotated[float, Field(gt=0, le=1)] = 0.65
    free_thresh: Annotated[float, Field(ge=0, lt=1)] = 0.196
    mode: Literal["trinary", "scale", "raw"] = "trinary"

    @model_validator(mode="after")
    def _supported(self) -> Self:
        if self.free_thresh >= self.occupied_thresh:
            raise ValueError("free_thresh must be smaller than occupied_thresh")
        if self.origin[2] != 0:
            raise ValueError("origin: a turned map (yaw other than 0) is not supported; turn the picture instead")
        return self


class _Point(BaseModel):
    model_config = ConfigDict(extra="forbid")
    x: FiniteFloat
    y: FiniteFloat


class _Position(_Point):
    yaw: FiniteFloat = 0.0


class _Place(BaseModel):
    model_config = ConfigDict(extra="forbid")
    id: Annotated[str, Field(min_length=1, max_length=80)]
    name: Annotated[str, Field(min_length=1, max_length=80)]
    type: PlaceKind = "space"
    position: _Position
    sign: _Point | None = None


class _PlacesYaml(BaseModel):
    model_config = ConfigDict(extra="forbid")
    frame_id: str = "map"
    places: Annotated[list[_Place], Field(min_length=1)]
    edges: list[tuple[str, str]] = []

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for names in ([p.id for p in self.places], [p.name.casefold() for p in self.places]):
            twice = {name for name in names if names.count(name) > 1}
            if twice:
                raise ValueError(f"places: {sorted(twice)[0]!r} is there twice")
        known = {p.id for p in self.places}
        for edge in self.edges:
            for end in edge:
                if end not in known:
                    raise ValueError(f"edges: there is no place with the id {end!r}")
        return self


def load(world: str) -> World:
    """Load a built-in world by its name, or any world by the path of its folder. Raises `WorldError`."""
    built_in = sorted(path.name for path in BUILT_IN.iterdir() if (path / "map.yaml").is_file())
    folder = BUILT_IN / world if world in built_in else Path(world).expanduser()
    if not (folder / "map.yaml").is_file():
        names = ", ".join(built_in)
        raise WorldError(f"There is no world {world!r}: neither built in ({names}) nor a folder with a map.yaml.")
    grid, shades = _load_map(folder / "map.yaml")
    places, signs = _load_places(folder / "places.yaml")
    for place in places.places:
        if grid.state(place.pose.x, place.pose.y) != FREE:
            where = f"({place.pose.x:g}, {place.pose.y:g})"
            raise WorldError(f"{folder / 'places.yaml'}: {place.name} {where} is not on free floor.")
    return World(grid, shades, places, signs)


def _load_map(file: Path) -> tuple[OccupancyGrid, npt.NDArray[np.uint8]]:
    meta = _read(file, _MapYaml)
    picture = file.parent / meta.image
    try:
        with Image.open(picture) as image:
            if image.width * image.height > MAX_CELLS:
                raise WorldError(f"{picture}: {image.width} x {image.height} is more than {MAX_CELLS} cells.")
            pixels = np.asarray(image.convert("LA"), dtype=np.uint8)[::-1]
    except (FileNotFoundError, UnidentifiedImageError) as error:
        raise WorldError(f"{picture} cannot be read as a picture: {error}") from None
    values, alpha = pixels[:, :, 0], pixels[:, :, 1]
    cells = _trinary(meta, values, alpha)
    shades = 255 - values if meta.negate else values.copy()
    # A camera sees walls where the robot must not go: one look for both, whatever the thresholds.
    shades[(cells == OCCUPIED) & (shades >= MIDDLE_GREY)] = 0
    shades[(cells == FREE) & (shades <= MIDDLE_GREY)] = 254
    shades[cells == UNKNOWN] = MIDDLE_GREY
    shades.flags.writeable = cells.flags.writeable = False
    return OccupancyGrid(cells, meta.resolution, meta.origin[0], meta.origin[1]), shades


def _trinary(meta: _MapYaml, values: npt.NDArray[np.uint8], alpha: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Cells as map_server makes them (nav2_map_server, map_io.cpp); `scale` is cut at the same thresholds."""
    if meta.mode == "raw":
        occupancy = values / 100.0
        unknown = values > 100
    else:
        occupancy = values / 255.0 if meta.negate else (255 - values) / 255.0
        unknown = alpha < 255
    cells = np.full(values.shape, UNKNOWN, dtype=np.uint8)
    cells[occupancy >= meta.occupied_thresh] = OCCUPIED
    cells[occupancy <= meta.free_thresh] = FREE
    cells[unknown] = UNKNOWN
    return cells


def _load_places(file: Path) -> tuple[TopologicalMap, tuple[Sign, ...]]:
    data = _read(file, _PlacesYaml)
    places = tuple(Place(p.id, p.name, p.type, Pose(p.position.x, p.position.y, p.position.yaw)) for p in data.places)
    signs = tuple(Sign(p.name, p.sign.x, p.sign.y) for p in data.places if p.sign)
    return TopologicalMap(data.frame_id, places, tuple(data.edges)), signs


def _read(file: Path, model: type[Model]) -> Model:
    try:
        content: Any = yaml.safe_load(file.read_text(encoding="utf-8"))
        return model.model_validate(content)
    except FileNotFoundError:
        raise WorldError(f"{file} is missing.") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise WorldError(f"{file} is not valid YAML: {error}") from None
    except ValidationError as error:
        lines = [f"  {'.'.join(map(str, item['loc'])) or 'file'}: {item['msg']}" for item in error.errors()]
        raise WorldError(f"{file} cannot be used:\n" + "\n".join(lines)) from None
