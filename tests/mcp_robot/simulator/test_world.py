"""A world is read as ROS reads it, and a wrong one is told with the file and the field."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from backend.mcp_robot.navigation.grid import FREE, OCCUPIED, UNKNOWN
from backend.mcp_robot.simulator import world
from backend.mcp_robot.simulator.world import World, WorldError
from backend.mcp_robot.worlds import make_hospital, make_office
from backend.mcp_robot.worlds.plan import YAML

MAP = """\
image: map.pgm
resolution: 2.0
origin: [-2.0, 2.0, 0.0]
negate: {negate}
occupied_thresh: 0.65
free_thresh: 0.196
"""
PLACES = "places: [{id: a, name: hall, position: {x: -1, y: 3}}]"


def make(folder: Path, pixels: list[list[int]], *, negate: int = 0, map_yaml: str = MAP, places: str = PLACES) -> str:
    Image.fromarray(np.array(pixels, dtype=np.uint8)).save(folder / "map.pgm")
    (folder / "map.yaml").write_text(map_yaml.format(negate=negate))
    (folder / "places.yaml").write_text(places)
    return str(folder)


def test_the_bottom_row_of_the_picture_is_row_zero_and_shades_become_three_states(tmp_path: Path) -> None:
    grid = world.load(make(tmp_path, [[205, 0], [254, 100]])).grid
    assert grid.cells.tolist() == [[FREE, UNKNOWN], [UNKNOWN, OCCUPIED]]
    assert grid.state(-1.99, 2.01) == FREE
    assert grid.state(1.99, 5.99) == OCCUPIED
    assert grid.state(2.01, 3.0) is None


def test_negate_swaps_black_and_white(tmp_path: Path) -> None:
    grid = world.load(make(tmp_path, [[255, 255], [0, 255]], negate=1)).grid
    assert grid.cells.tolist() == [[FREE, OCCUPIED], [OCCUPIED, OCCUPIED]]


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"map_yaml": MAP.replace("resolution: 2.0", "resolution: -1")}, "resolution"),
        ({"map_yaml": MAP.replace("2.0, 0.0", "2.0, 0.3")}, "turned map"),
        ({"map_yaml": MAP.replace("0.196", "0.9")}, "free_thresh must be smaller"),
        ({"map_yaml": MAP.replace("map.pgm", "other.png")}, "other.png"),
        ({"places": "places: []"}, "places"),
        ({"places": PLACES.replace("-1", "1")}, "hall (1, 3) is not on free floor"),
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


@pytest.mark.parametrize("script", [make_office, make_hospital])
def test_a_built_in_world_on_disk_is_what_its_script_draws(script: Any) -> None:
    with Image.open(script.FOLDER / "map.png") as kept:
        assert np.array_equal(np.asarray(kept), np.asarray(script.draw()))
    assert (script.FOLDER / "map.yaml").read_text() == YAML
    assert (script.FOLDER / "map.png").stat().st_size < 20_000


def test_the_hospital_is_100_by_60_metres_with_more_than_40_places_and_two_docks() -> None:
    hospital = world.load("hospital")
    assert (make_hospital.FOLDER / "places.yaml").read_text() == make_hospital.build().yaml
    rows, columns = np.nonzero(hospital.grid.cells != UNKNOWN)
    assert np.ptp(columns) * 0.05 == pytest.approx(100.0, abs=0.3)
    assert np.ptp(rows) * 0.05 == pytest.approx(60.0, abs=0.3)
    assert len(hospital.places.places) > 40
    assert sum(place.kind == "docking" for place in hospital.places.places) == 2
    assert len(hospital.doors) > 40
    joined = {hospital.places.places[0].id}
    for _ in hospital.places.edges:
        joined |= {end for edge in hospital.places.edges if joined & set(edge) for end in edge}
    assert joined == {place.id for place in hospital.places.places}


def test_any_ros_map_is_a_world_by_the_path_of_its_yaml_or_folder_with_or_without_places(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = Path(make(tmp_path, [[254, 254], [254, 0]]))
    (folder / "map.yaml").rename(folder / "turtlebot3_world.yaml")
    with_places = world.load(str(folder / "turtlebot3_world.yaml"))
    assert [place.name for place in with_places.places.places] == ["hall"]
    (folder / "places.yaml").unlink()
    without = world.load(str(folder / "turtlebot3_world.yaml"))
    assert without.places.places == ()
    assert without.grid.state(without.start.x, without.start.y) == FREE
    assert "places.yaml is missing: the robot knows no places by name" in caplog.text
    with pytest.raises(WorldError, match="no world"):
        world.load(str(folder))


def test_without_places_the_robot_begins_at_the_origin_of_the_map_or_near_it(tmp_path: Path) -> None:
    pixels = np.full((100, 100), 254, dtype=np.uint8)
    pixels[60:90, 10:40] = 0
    folder = make(
        tmp_path,
        pixels.tolist(),
        map_yaml=MAP.replace("resolution: 2.0", "resolution: 0.05").replace("-2.0, 2", "-1.0, -1"),
    )
    (Path(folder) / "places.yaml").unlink()
    building = world.load(folder)
    assert building.grid.clearance(building.start.x, building.start.y) >= 0.4
    assert np.hypot(building.start.x, building.start.y) < 1.5


def test_scale_and_raw_maps_are_cut_at_their_thresholds(tmp_path: Path) -> None:
    scale = MAP + "mode: scale\n"
    assert world.load(make(tmp_path, [[254, 100], [254, 60]], map_yaml=scale)).grid.cells.tolist() == [
        [FREE, OCCUPIED],
        [FREE, UNKNOWN],
    ]
    raw = MAP + "mode: raw\n"
    assert world.load(make(tmp_path, [[0, 100], [0, 255]], map_yaml=raw)).grid.cells.tolist() == [
        [FREE, UNKNOWN],
        [FREE, OCCUPIED],
    ]


def test_a_map_without_free_floor_is_told_with_what_to_look_at(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match=r"no free cell; look at negate"):
        world.load(make(tmp_path, [[0, 0], [0, 0]]))


def test_a_door_must_stand_on_free_floor(tmp_path: Path) -> None:
    doors = PLACES + "\ndoors: [{id: gate, start: {x: 1, y: 3}, end: {x: 1, y: 5}}]"
    with pytest.raises(WorldError, match=r"door gate .* is not on free floor"):
        world.load(make(tmp_path, [[254, 0], [254, 0]], places=doors))
