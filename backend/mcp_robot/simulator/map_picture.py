"""Reads the picture of a map: how bright each pixel is, at the depth that the file has.

The file is outside input: only formats and depths are read whose black and white are known, whatever else Pillow can
open. A picture that cannot be read to its end is refused. Nothing is written.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from backend.mcp_robot.navigation.grid import MAX_CELLS
from backend.mcp_robot.simulator.yaml_file import WorldError

FORMATS = ("PNG", "PPM", "BMP", "JPEG")  # PPM: also PGM and PBM
MAX_BYTES = 300_000_000
"""The largest file: somewhat more than MAX_CELLS pixels of four bytes."""
_COLOURED = ("P", "PA", "LA", "RGB", "RGBA")
_DEEP = ("I;16", "I;16L", "I;16B", "I;16N")


Levels = npt.NDArray[np.unsignedinteger[Any]]


@dataclass(frozen=True, eq=False)
class MapPicture:
    """`levels[row, column]` are from 0 (black) to `white`, row 0 at the bottom. Of a colour it is the sum of red, green
    and blue. `opaque` is None where every pixel is."""

    levels: Levels
    white: int
    opaque: npt.NDArray[np.bool_] | None


def read(file: Path) -> MapPicture:
    """The picture in this file. Raises `WorldError`."""
    try:
        if not file.is_file():
            raise WorldError(f"{file} cannot be read as a picture: there is no such file.")
        if file.stat().st_size > MAX_BYTES:
            raise WorldError(f"{file} is larger than {MAX_BYTES} bytes, the most that is read.")
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            image = Image.open(file, formats=FORMATS)
        with image:
            if image.width * image.height > MAX_CELLS:
                raise WorldError(f"{file}: {image.width} x {image.height} is more than {MAX_CELLS} cells.")
            return _levels(image, file)
    except WorldError:
        raise
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise WorldError(f"{file}: the picture is far larger than {MAX_CELLS} cells.") from None
    except OSError as error:
        reason = error.strerror or "it is no PNG, PGM, PBM, PPM, BMP or JPEG, or not all of it is there"
        raise WorldError(f"{file} cannot be read as a picture: {reason}.") from None
    except Exception as error:  # what decoders raise for a damaged file is not documented
        raise WorldError(f"{file} cannot be read as a picture: {type(error).__name__}.") from None


def _levels(image: Image.Image, file: Path) -> MapPicture:
    mode, clear = image.mode, image.info.get("transparency")
    if mode in ("1", "L") and clear is None:
        return MapPicture(_upwards(image.convert("L"), np.uint8), 255, None)
    if mode in ("1", "L", *_COLOURED):
        pixels = np.asarray(image.convert("RGBA"), dtype=np.uint8)[::-1]
        opaque = pixels[:, :, 3] == 255
        levels = pixels[:, :, 0].astype(np.uint16) + pixels[:, :, 1] + pixels[:, :, 2]
        return MapPicture(levels, 3 * 255, None if opaque.all() else opaque)
    # Pillow gives a PGM of more than 255 levels as 32 bit integers, scaled to 16 bits.
    if mode in _DEEP or (mode == "I" and image.format in ("PPM", "PNG")):
        levels = _upwards(image, np.uint16)
        return MapPicture(levels, 65535, None if clear is None else levels != clear)
    advice = "Save it in grey, in colours or with a palette, of 8 or 16 bits."
    raise WorldError(f"{file}: pixels of the kind {mode} cannot be read. {advice}")


def _upwards(image: Image.Image, depth: type[np.uint8] | type[np.uint16]) -> Levels:
    """The pixels in this depth, the bottom row first."""
    return np.ascontiguousarray(np.asarray(image)[::-1].astype(depth))
