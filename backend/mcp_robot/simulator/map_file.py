"""Reads a map in ROS map_server format: `map.yaml` and its picture, as nav2_map_server would.

The files are outside input: they are checked here once, and an error names the file, the field and the reason. Nothing
is written.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
import numpy.typing as npt
import yaml
from PIL import Image, UnidentifiedImageError
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, model_validator

from backend.config import ConfigError
from backend.mcp_robot.navigation.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

Model = TypeVar("Model", bound=BaseModel)

MAX_CELLS = 64_000_000
MIDDLE_GREY = 205
"""The shade that map_saver gives to unknown cells."""


class WorldError(ConfigError):
    """A world that cannot be used; the text names the file and the reason."""


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


def load(file: Path) -> tuple[OccupancyGrid, npt.NDArray[np.uint8]]:
    """The grid, and the picture's shades in its shape (row 0 at the bottom, dark is occupied). Raises `WorldError`."""
    meta = read(file, _MapYaml)
    picture = file.parent / meta.image
    try:
        with Image.open(picture) as image:
            if image.width * image.height > MAX_CELLS:
                raise WorldError(f"{picture}: {image.width} x {image.height} is more than {MAX_CELLS} cells.")
            pixels = np.asarray(image.convert("LA"), dtype=np.uint8)[::-1]
    except (OSError, UnidentifiedImageError) as error:
        raise WorldError(f"{picture} cannot be read as a picture: {error}") from None
    values, alpha = pixels[:, :, 0], pixels[:, :, 1]
    cells = _trinary(meta, values, alpha)
    shades = 255 - values if meta.negate else values.copy()
    # The camera has to show walls exactly where the robot must not drive, whatever the thresholds are.
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


def read(file: Path, model: type[Model]) -> Model:
    """A YAML file as this model. Raises `WorldError`."""
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
