"""A world that cannot be used ends in a sentence and the status of unusable settings, whatever is wrong with it."""

from __future__ import annotations

import contextlib
import os
import shutil
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from backend import config
from backend.cli import main
from backend.config import ConfigError
from backend.mcp_robot import robots
from backend.mcp_robot.simulator import world
from backend.mcp_robot.simulator.world import BUILT_IN, WorldError

NOBODY = 65534
DESK = "  - {id: desk, name: desk, position: {x: 3, y: 9}}\n"


@pytest.fixture
def office_copy(tmp_path: Path) -> Path:
    return Path(shutil.copytree(BUILT_IN / "office", tmp_path / "copy"))


def complaint(folder: Path) -> str:
    with pytest.raises(WorldError) as error:
        world.load(str(folder))
    return str(error.value)


def replaced(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ({"id": "a", "name": "desk"}, {"id": "b", "name": "the desk"}),
        ({"id": "a", "name": "mesa"}, {"id": "b", "name": "La Mesa"}),
        ({"id": "a", "name": "your desk"}, {"id": "b", "name": "a desk"}),
        ({"id": "a", "name": "lab 1-11"}, {"id": "b", "name": "lab 11.1"}),
        ({"id": "a", "name": "b"}, {"id": "b", "name": "desk"}),
        ({"id": "a", "name": "desk"}, {"id": "the-desk", "name": "b"}),
        ({"id": "a", "name": "Straße"}, {"id": "b", "name": "STRASSE"}),
        ({"id": "a", "name": "cafeter\u00eda"}, {"id": "b", "name": "cafeteri\u0301a"}),
        ({"id": "a", "name": "lab \u2461"}, {"id": "b", "name": "lab 2"}),
    ],
)
def test_two_places_that_one_name_means_are_refused(
    office_copy: Path, one: dict[str, str], other: dict[str, str]
) -> None:
    lines = [f"  - {{id: {p['id']}, name: {p['name']}, position: {{x: 3, y: 9}}}}\n" for p in (one, other)]
    (office_copy / "places.yaml").write_text("places:\n" + "".join(lines))
    text = complaint(office_copy)
    assert f"could not tell {one['name']} ({one['id']}) from {other['name']} ({other['id']})" in text
    with pytest.raises(WorldError, match="could not tell"):  # as a ROS 2 robot reads it, whose map comes from elsewhere
        world.names(str(office_copy / "places.yaml"))


def test_names_that_differ_for_people_are_not_refused(office_copy: Path) -> None:
    names = ["desk", "front desk", "desk 2", "lab 1.1", "lab 2.1", "mesa", "labels", "कि", "का", "日本", "日"]
    lines = [f"  - {{id: p{i}, name: {name}, position: {{x: 3, y: 9}}}}\n" for i, name in enumerate(names)]
    (office_copy / "places.yaml").write_text("places:\n" + "".join(lines))
    assert [place.name for place in world.load(str(office_copy)).places.places] == names


@pytest.mark.parametrize("name", ["'…'", "'-'", '"a\\u202eb"', '"a\\nb"', '"\\u200b"', "''", "x" + "y" * 80])
def test_a_name_that_nobody_can_read_is_refused(office_copy: Path, name: str) -> None:
    (office_copy / "places.yaml").write_text(f"places:\n  - {{id: a, name: {name}, position: {{x: 3, y: 9}}}}\n")
    assert "places.0.name" in complaint(office_copy)


def test_all_places_that_nobody_can_drive_to_are_named_with_where_they_could_be(office_copy: Path) -> None:
    (office_copy / "places.yaml").write_text(
        "places:\n"
        "  - {id: dock, name: dock, type: docking, position: {x: 0.5, y: 3.1}}\n"  # 0.15 m before the dock's base
        "  - {id: wall, name: wall, position: {x: 0, y: 5}}\n"
        "  - {id: far, name: far, position: {x: 30, y: 5}}\n" + DESK
    )
    text = complaint(office_copy)
    assert "dock (0.5, 3.1) is too close to a wall: the robot needs 0.30 m around it. Choose a free spot, as" in text
    assert "wall (0, 5) is not on free floor. Choose a free spot, as near as (" in text
    assert "far (30, 5) is outside the map (x from -0.5 to 24.5, y from -0.5 to 14.5). Look at" in text
    assert "desk" not in text


def test_a_resolution_that_puts_places_off_the_map_is_told_with_the_maps_extent(office_copy: Path) -> None:
    replaced(office_copy / "map.yaml", "resolution: 0.05", "resolution: 0.01")
    text = complaint(office_copy)
    assert "is outside the map (x from -0.5 to 4.5, y from -0.5 to 2.5). Look at its position, and at the map's" in text
    assert "more" in text.splitlines()[-1]


def test_a_door_off_the_map_is_refused(office_copy: Path) -> None:
    door = "doors: [{id: gate, start: {x: 3, y: 9}, end: {x: 3, y: 900000}}]\n"
    (office_copy / "places.yaml").write_text("places:\n" + DESK + door)
    assert "door gate (3, 900000) is outside the map" in complaint(office_copy)


BAD_MAP_YAML = {
    "a key that is not known": ("negate: 0", "negate: 0\nresolutoin: 1", "resolutoin: there is no such key"),
    "a key that is there twice": ("negate: 0", "negate: 0\nresolution: 1", "key resolution is there twice"),
    "a flag for a number": ("resolution: 0.05", "resolution: yes", "resolution: Value error, must be a number"),
    "no number": ("resolution: 0.05", "resolution: .nan", "resolution: "),
    "a cell of no size": ("resolution: 0.05", "resolution: 1e-9", "resolution: "),
    "an origin beyond all numbers": ("[-0.5, -0.5, 0.0]", "[1e308, -0.5, 0.0]", "origin.0: "),
    "a number of 9,999 digits": ("resolution: 0.05", f"resolution: {'9' * 9999}", "not valid YAML"),
    "a date that is none": ("map.png", "2024-99-99", "not valid YAML"),
    "aliases that grow": (
        "image: map.png",
        "image: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]",
        "line 2, column 8: aliases such as *a are not read",
    ),
    "depth": ("image: map.png", "image: " + "[" * 50_000, "more than 20 levels"),
    "a Python object": ("map.png", "!!python/object/apply:os.getpid []", "could not determine a constructor"),
    "a control character": ("map.png", "\x01", "not valid YAML"),
    "a list": ("mode: trinary", "mode: [trinary]", "mode: "),
    "an image that is not there": ("map.png", "other.png", "other.png cannot be read as a picture: there is no"),
    "a folder as the image": ("map.png", ".", "cannot be read as a picture: there is no such file"),
    "a device as the image": ("map.png", "/dev/zero", "cannot be read as a picture: there is no such file"),
    "a name that no file can have": ("map.png", '"a\\0b"', "cannot be read as a picture"),
    "a name that is too long": ("map.png", "x" * 3000, "cannot be read as a picture"),
    "no room for the robot": ("resolution: 0.05", "resolution: 0.005", "outside the map"),
}


@pytest.mark.parametrize("kind", BAD_MAP_YAML)
def test_a_wrong_map_yaml_is_told(office_copy: Path, kind: str) -> None:
    old, new, told = BAD_MAP_YAML[kind]
    replaced(office_copy / "map.yaml", old, new)
    assert told in complaint(office_copy)


def png(width: int, height: int) -> bytes:
    """A PNG that says it has so many pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")


BAD_PICTURES = {
    "nothing": (b"", "it is no PNG"),
    "text": (b"hello", "it is no PNG"),
    "half a picture": ((BUILT_IN / "office" / "map.png").read_bytes()[:900], "not all of it is there"),
    "a bomb": (png(60_000, 60_000), "far larger than 64000000 cells"),
    "a large picture": (png(9_000, 9_000), "9000 x 9000 is more than 64000000 cells"),
    "no pixels": (png(0, 0), "cannot be read as a picture"),
    "PostScript, for which Pillow starts a program": (
        b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\nshowpage\n",
        "it is no PNG",
    ),
    "a PGM of huge size": (b"P5 9999999999 9999999999 255 x", "far larger"),
    "a larger picture": (png(10_000, 10_000), "far larger"),
    "a PGM that is no number": (b"P5 a b 255 x", "cannot be read as a picture"),
}


@pytest.mark.parametrize("kind", BAD_PICTURES)
def test_a_wrong_picture_is_told(office_copy: Path, kind: str) -> None:
    content, told = BAD_PICTURES[kind]
    (office_copy / "map.png").write_bytes(content)
    text = complaint(office_copy)
    assert told in text
    assert "map.png" in text


def folder(file: Path) -> None:
    file.unlink(missing_ok=True)
    file.mkdir()


def dangling(file: Path) -> None:
    file.unlink(missing_ok=True)
    file.symlink_to("nowhere")


def pipe(file: Path) -> None:
    file.unlink(missing_ok=True)
    os.mkfifo(file)


def latin(file: Path) -> None:
    file.write_bytes("places: [caf\u00e9]".encode("latin-1"))


def large(file: Path) -> None:
    file.write_text("#" * 600_000)


@pytest.mark.parametrize("made", [folder, dangling, pipe, latin, large])
@pytest.mark.parametrize("name", ["places.yaml", "keep_out.yaml"])
def test_a_file_that_cannot_be_read_is_not_taken_for_one_that_is_not_there(
    office_copy: Path, name: str, made: Callable[[Path], None]
) -> None:
    made(office_copy / name)
    assert name in complaint(office_copy)


@contextlib.contextmanager
def ordinary_user() -> Iterator[None]:
    """Root may read every file; somebody else may not."""
    root = os.geteuid() == 0
    if root:
        os.seteuid(NOBODY)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)


@pytest.mark.parametrize("name", ["map.yaml", "map.png", "places.yaml", "keep_out.yaml", "."])
def test_a_file_or_folder_without_permission_is_told(office_copy: Path, name: str) -> None:
    for parent in (office_copy, office_copy.parent, office_copy.parent.parent):
        parent.chmod(0o755)
    (office_copy / "keep_out.yaml").write_text("zones: []")
    (office_copy / name).chmod(0)
    try:
        with ordinary_user():
            assert "cannot be read" in complaint(office_copy)
    finally:
        office_copy.chmod(0o755)


@pytest.mark.parametrize("name", ["", "x" * 5000, "a\0b", "~nobody-of-this-name/map", "/dev/null", "/dev/zero"])
def test_a_world_that_no_file_can_be_is_told(name: str) -> None:
    with pytest.raises(WorldError) as error:
        world.load(name)
    assert len(str(error.value)) < 400


@pytest.mark.parametrize(
    ("places", "told"),
    [
        ("frame_id: odom\nplaces:\n" + DESK, "frame_id is odom, but the robot's map has the frame map"),
        ("places:\n" + DESK + DESK, "'desk' is there twice"),
        ("places: [", "not valid YAML"),
    ],
)
def test_the_places_of_a_ros_2_robot_are_checked_before_it_starts(tmp_path: Path, places: str, told: str) -> None:
    (tmp_path / "places.yaml").write_text(places)
    ros2 = config.Ros2(places=str(tmp_path / "places.yaml"))
    with pytest.raises(WorldError, match=told):
        robots.ros2(config.Settings(data_dir=tmp_path, robot=config.Robot(kind="ros2", ros2=ros2)))


def test_the_command_ends_with_a_sentence_and_the_status_of_unusable_settings(office_copy: Path) -> None:
    (office_copy / "map.png").write_bytes(b"hello")
    command = [sys.executable, "-m", "backend.cli", "--data-dir", str(office_copy / "data"), "robot"]
    ended = subprocess.run([*command, "--world", str(office_copy)], capture_output=True, text=True, timeout=120)
    assert ended.returncode == 2
    assert ended.stderr.startswith("robot-acp: ")
    assert "map.png cannot be read as a picture" in ended.stderr
    assert len(ended.stderr.splitlines()) == 1


@pytest.mark.parametrize("setting", [["--world", "atlantis"], ["--world", "/dev/null"]])
def test_nothing_of_a_world_is_a_traceback(
    tmp_path: Path, setting: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert issubclass(WorldError, ConfigError)
    assert main(["--data-dir", str(tmp_path), "robot", *setting]) == 2
    assert capsys.readouterr().err.startswith("robot-acp: There is no world")


def test_a_door_that_is_closed_and_that_the_world_does_not_have_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ROBOT_ACP_ROBOT__SIMULATOR__CLOSED_DOORS", '["none"]')
    assert main(["--data-dir", str(tmp_path), "robot"]) == 2
    assert "There is no door 'none' in this world" in capsys.readouterr().err
