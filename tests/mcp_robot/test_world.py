"""A world is read as ROS reads it, and a wrong one is told with the file and the field."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from backend.mcp_robot.grid import FREE, OCCUPIED, UNKNOWN
from backend.mcp_robot.simulator import world
from backend.mcp_robot.simulator.world import World, WorldError
from backend.mcp_robot.worlds import make_office

MAP = """\
image: map.pgm
resolution: 0.5
origin: [-1.0, 2.0, 0.0]
negate: {negate}
occupied_thresh: 0.65
free_thresh: 0.196
"""
PLACES = "places: [{id: a, name: hall, position: {x: -0.75, y: 2.25}}]"


def make(folder: Path, pixels: list[list[int]], *, negate: int = 0, map_yaml: str = MAP, places: str = PLACES) -> str:
    Image.fromarray(np.array(pixels, dtype=np.uint8)).save(folder / "map.pgm")
    (folder / "map.yaml").write_text(map_yaml.format(negate=negate))
    (folder / "places.yaml").write_text(places)
    return str(folder)


def test_the_bottom_row_of_the_picture_is_row_zero_and_shades_become_three_states(tmp_path: Path) -> None:
    grid = world.load(make(tmp_path, [[205, 0], [254, 100]])).grid
    assert grid.cells.tolist() == [[FREE, UNKNOWN], [UNKNOWN, OCCUPIED]]
    assert grid.state(-0.99, 2.01) == FREE
    assert grid.state(-0.01, 2.99) == OCCUPIED
    assert grid.state(0.01, 2.5) is None


def test_negate_swaps_black_and_white(tmp_path: Path) -> None:
    grid = world.load(make(tmp_path, [[255, 255], [0, 255]], negate=1)).grid
    assert grid.cells.tolist() == [[FREE, OCCUPIED], [OCCUPIED, OCCUPIED]]


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"map_yaml": MAP.replace("0.5", "-1")}, "resolution"),
        ({"map_yaml": MAP.replace("2.0, 0.0", "2.0, 0.3")}, "turned map"),
        ({"map_yaml": MAP.replace("0.196", "0.9")}, "free_thresh must be smaller"),
        ({"map_yaml": MAP.replace("map.pgm", "other.png")}, "other.png"),
        ({"places": "places: []"}, "places"),
        ({"places": PLACES.replace("-0.75", "0.25")}, "hall (0.25, 2.25) is not on free floor"),
        ({"places": PLACES + "\nedges: [[a, b]]"}, "no place with the id 'b'"),
        ({"places": "places: [}"}, "not valid YAML"),
    ],
)
def test_a_wrong_world_is_told_with_what_is_wrong(tmp_path: Path, change: dict[str, str], complaint: str) -> None:
    folder = make(tmp_path, [[254, 0], [254, 0]], **change)  # type: ignore[arg-type]
    with pytest.raises(WorldError, match=r".") as error:
        world.load(folder)
    assert complaint in str(error.value)


def test_an_unknown_world_is_told_with_the_built_in_ones() -> None:
    with pytest.raises(WorldError, match=r"no world 'atlantis'.*office"):
        world.load("atlantis")


def test_the_office_has_its_labs_kitchen_reception_corridor_and_a_dock_to_start_from(office: World) -> None:
    names = {place.name for place in office.places.places}
    assert names == {f"lab 2.3.{n}" for n in range(1, 10)} | {"kitchen", "reception", "corridor", "dock"}
    dock = next(place for place in office.places.places if place.kind == "docking")
    assert office.start == dock.pose


def test_the_office_on_disk_is_what_its_script_draws() -> None:
    with Image.open(make_office.FOLDER / "map.png") as kept:
        assert np.array_equal(np.asarray(kept), np.asarray(make_office.draw()))
    assert (make_office.FOLDER / "map.yaml").read_text() == make_office.YAML
