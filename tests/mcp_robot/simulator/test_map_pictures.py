"""A map's picture keeps its walls at every depth and in every colour, or is refused; never is a wall free floor."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from backend.mcp_robot.navigation.grid import FREE, OCCUPIED, UNKNOWN
from backend.mcp_robot.simulator import map_file, world
from backend.mcp_robot.simulator.world import World, WorldError
from backend.mcp_robot.worlds import make_office

SHADES = np.array([[0, 20, 89, 90], [100, 205, 206, 254]], dtype=np.uint8)
STATES = [
    [OCCUPIED, OCCUPIED, OCCUPIED, UNKNOWN],  # 89 is 0.651 occupied, 90 is 0.647
    [UNKNOWN, UNKNOWN, FREE, FREE],  # 205 is 0.1961 occupied, 206 is 0.192
]


def cells(folder: Path, name: str, mode: str = "trinary", **fields: Any) -> npt.NDArray[np.uint8]:
    """The cells of a map with this picture, the top row first."""
    lines = [f"{key}: {value}" for key, value in fields.items()]
    text = f"image: {name}\nresolution: 0.05\norigin: [0, 0, 0]\nmode: {mode}\n" + "\n".join(lines)
    (folder / "map.yaml").write_text(text)
    grid, shades = map_file.load(folder / "map.yaml")
    assert shades.shape == grid.cells.shape
    return grid.cells[::-1]


def deep(shades: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint16]:
    return shades.astype(np.uint16) * 257


def pgm(levels: npt.NDArray[Any], most: int) -> bytes:
    data = levels.astype(">u2" if most > 255 else "u1").tobytes()
    return b"P5\n%d %d\n%d\n" % (levels.shape[1], levels.shape[0], most) + data


@pytest.mark.parametrize("negate", [0, 1])
def test_grey_of_16_bits_is_what_it_is_of_8(tmp_path: Path, negate: int) -> None:
    shades = 255 - SHADES if negate else SHADES
    Image.fromarray(shades).save(tmp_path / "8.png")
    Image.fromarray(deep(shades)).save(tmp_path / "16.png")
    (tmp_path / "8.pgm").write_bytes(pgm(shades, 255))
    (tmp_path / "16.pgm").write_bytes(pgm(deep(shades), 65535))
    (tmp_path / "plain.pgm").write_text(f"P2\n4 2\n65535\n{' '.join(map(str, deep(shades).ravel()))}\n")
    (tmp_path / "10.pgm").write_bytes(pgm(shades.astype(np.uint16) * 4, 1020))
    for name in ("8.png", "16.png", "8.pgm", "16.pgm", "plain.pgm", "10.pgm"):
        assert cells(tmp_path, name, negate=negate).tolist() == STATES, name


def test_the_office_of_16_bits_has_the_walls_of_the_office(tmp_path: Path, office: World) -> None:
    for file in make_office.FOLDER.iterdir():
        if file.suffix == ".yaml":
            (tmp_path / file.name).write_text(file.read_text().replace("map.png", "map.pgm"))
    (tmp_path / "map.pgm").write_bytes(pgm(deep(np.asarray(make_office.draw())), 65535))
    deeper = world.load(str(tmp_path))
    assert np.array_equal(deeper.grid.cells, office.grid.cells)
    assert np.array_equal(deeper.shades, office.shades)


def test_every_level_of_16_bits_lies_on_the_right_side_of_the_thresholds(tmp_path: Path) -> None:
    levels = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    Image.fromarray(levels).save(tmp_path / "all.png")
    found = cells(tmp_path, "all.png", free_thresh=0.25, occupied_thresh=0.5).ravel()
    occupancy = (65535 - levels.ravel()) / 65535
    assert (found[occupancy >= 0.5] == OCCUPIED).all()
    assert (found[(occupancy >= 0.25) & (occupancy < 0.5)] == UNKNOWN).all()
    assert (found[occupancy < 0.25] == FREE).all()


@pytest.mark.parametrize("name", ["p.png", "rgb.png", "rgb.bmp", "rgb.ppm", "rgba.png", "la.png", "16-alpha.png"])
def test_colours_palettes_and_an_opaque_alpha_change_nothing(tmp_path: Path, name: str) -> None:
    grey = Image.fromarray(SHADES)
    modes = {"p": "P", "rgb": "RGB", "rgba": "RGBA", "la": "LA", "16-alpha": "LA"}
    grey.convert(modes[name.partition(".")[0]]).save(tmp_path / name)
    assert cells(tmp_path, name).tolist() == STATES


def test_a_colour_is_as_bright_as_the_mean_of_its_parts_as_map_server_has_it(tmp_path: Path) -> None:
    yellow, blue, white = (255, 255, 0), (0, 0, 255), (255, 255, 255)
    Image.fromarray(np.array([[yellow, blue, white]], dtype=np.uint8)).save(tmp_path / "map.png")
    assert cells(tmp_path, "map.png").tolist() == [[UNKNOWN, OCCUPIED, FREE]]


@pytest.mark.parametrize("mode", ["trinary", "scale"])
def test_what_is_not_opaque_is_unknown(tmp_path: Path, mode: str) -> None:
    pixels = np.array([[[254, 255], [254, 254], [0, 0], [0, 255]]], dtype=np.uint8)
    Image.fromarray(pixels, mode="LA").save(tmp_path / "la.png")
    assert cells(tmp_path, "la.png", mode).tolist() == [[FREE, UNKNOWN, UNKNOWN, OCCUPIED]]
    palette = Image.fromarray(np.array([[0, 1, 2]], dtype=np.uint8), mode="P")
    palette.putpalette([0, 0, 0, 254, 254, 254, 254, 254, 254])
    palette.save(tmp_path / "p.png", transparency=2)
    assert cells(tmp_path, "p.png", mode).tolist() == [[OCCUPIED, FREE, UNKNOWN]]
    Image.fromarray(np.array([[0, 65000, 65535]], dtype=np.uint16)).save(tmp_path / "16.png", transparency=65000)
    assert cells(tmp_path, "16.png", mode).tolist() == [[OCCUPIED, UNKNOWN, FREE]]


def test_one_bit_is_black_or_white(tmp_path: Path) -> None:
    (tmp_path / "map.pbm").write_bytes(b"P4\n2 1\n" + bytes([0b10000000]))  # in a bitmap 1 is black
    Image.fromarray(np.array([[False, True]])).save(tmp_path / "map.png")
    for name in ("map.pbm", "map.png"):
        assert cells(tmp_path, name).tolist() == [[OCCUPIED, FREE]], name


def test_raw_levels_are_percent_at_every_depth(tmp_path: Path) -> None:
    levels = np.array([[0, 19, 50, 65, 100, 101, 255]], dtype=np.uint8)
    Image.fromarray(levels).save(tmp_path / "8.png")
    Image.fromarray(deep(levels)).save(tmp_path / "16.png")
    for name in ("8.png", "16.png"):
        wanted = [[FREE, FREE, UNKNOWN, OCCUPIED, OCCUPIED, UNKNOWN, UNKNOWN]]
        assert cells(tmp_path, name, "raw").tolist() == wanted, name


@pytest.mark.parametrize(
    ("name", "dtype", "complaint"),
    [
        ("float.tif", np.float32, "cannot be read as a picture"),
        ("int.tif", np.int32, "cannot be read as a picture"),
        ("float.pfm", np.float32, "pixels of the kind F cannot be read"),
    ],
)
def test_a_depth_whose_white_nobody_knows_is_refused(tmp_path: Path, name: str, dtype: Any, complaint: str) -> None:
    Image.fromarray(SHADES.astype(dtype)).save(tmp_path / name)
    with pytest.raises(WorldError, match=complaint):
        cells(tmp_path, name)
