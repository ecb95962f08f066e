"""Reads a map in ROS map_server format: `map.yaml` and its picture, as nav2_map_server would.

The files are outside input: they are checked here once, and an error names the file, the field and the reason. Nothing
is written.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, FiniteFloat, model_validator

from backend.mcp_robot.navigation.grid import COARSEST, FARTHEST, FINEST, FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from backend.mcp_robot.simulator import map_picture, yaml_file

MIDDLE_GREY = 205
"""The shade that map_saver gives to unknown cells."""


def _no_flag(value: Any) -> Any:
    """YAML reads `yes` and `on` as true, which would count as 1."""
    if isinstance(value, bool):
        raise ValueError("must be a number, not true or false")
    return value


Number = Annotated[FiniteFloat, BeforeValidator(_no_flag)]
Coordinate = Annotated[Number, Field(ge=-FARTHEST, le=FARTHEST)]
"""m in the map frame."""


class _MapYaml(BaseModel):
    """The fields that ROS 2's map_server reads."""

    model_config = ConfigDict(extra="forbid")

    image: Annotated[str, Field(min_length=1, max_length=4096)]
    resolution: Annotated[Number, Field(ge=FINEST, le=COARSEST)]
    origin: tuple[Coordinate, Coordinate, Coordinate]
    negate: bool = False
    occupied_thresh: Annotated[Number, Field(gt=0, le=1)] = 0.65
    free_thresh: Annotated[Number, Field(ge=0, lt=1)] = 0.196
    mode: Literal["trinary", "scale", "raw"] = "trinary"

    @model_validator(mode="after")
    def _supported(self) -> Self:
        if self.free_thresh >= self.occupied_thresh:
            raise ValueError("free_thresh must be smaller than occupied_thresh")
        if self.origin[2] != 0:
            raise ValueError("origin: a turned map (yaw other than 0) is not supported; turn the picture instead")
        return self


def load(file: Path) -> tuple[OccupancyGrid, npt.NDArray[np.uint8]]:
    """The grid, and the picture's shades in its shape (row 0 at the bottom, dark is occupied). Raises `WorldError`."""
    meta = yaml_file.read(file, _MapYaml)
    picture = map_picture.read(file.parent / meta.image)
    cells = _states(meta, picture.white)[picture.levels]
    if picture.opaque is not None and meta.mode != "raw":  # in `trinary`, map_server averages alpha with the colours
        cells[~picture.opaque] = UNKNOWN
    shades = _shades(meta, picture.white)[picture.levels]
    # The camera has to show walls exactly where the robot must not drive, whatever the thresholds are.
    shades[(cells == OCCUPIED) & (shades >= MIDDLE_GREY)] = 0
    shades[(cells == FREE) & (shades <= MIDDLE_GREY)] = 254
    shades[cells == UNKNOWN] = MIDDLE_GREY
    shades.flags.writeable = cells.flags.writeable = False
    return OccupancyGrid(cells, meta.resolution, meta.origin[0], meta.origin[1]), shades


def _states(meta: _MapYaml, white: int) -> npt.NDArray[np.uint8]:
    """The state of a cell for each level from 0 to `white`, as map_server has it (nav2_map_server, map_io.cpp).

    `scale` is cut at the same thresholds. A level that lies on one of them is never free.
    """
    levels = np.arange(white + 1)
    if meta.mode == "raw":
        percent = np.rint(levels * 255 / white)
        occupancy, unknown = percent / 100, percent > 100
    else:
        occupancy = (levels if meta.negate else white - levels) / white
        unknown = np.zeros(levels.shape, dtype=np.bool_)
    states = np.full(levels.shape, UNKNOWN, dtype=np.uint8)
    states[occupancy >= meta.occupied_thresh] = OCCUPIED
    states[occupancy < meta.free_thresh] = FREE
    states[unknown] = UNKNOWN
    return states


def _shades(meta: _MapYaml, white: int) -> npt.NDArray[np.uint8]:
    """The shade of 8 bits, dark where it is occupied, for each level from 0 to `white`."""
    shades = np.rint(np.arange(white + 1) * 255 / white).astype(np.uint8)
    return 255 - shades if meta.negate else shades
