"""The rooms of the robot server: which of them may import which, so that the safety rules stand on their own."""

from __future__ import annotations

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

BACKEND = Path(__file__).parents[2] / "backend"
ROBOT = BACKEND / "mcp_robot"
PACKAGE = "backend.mcp_robot"
FILES = sorted(ROBOT.rglob("*.py"))

FORBIDDEN = {
    "navigation": {"motion", "tools", "http", "simulator", "ros2", "worlds"},
    "motion": {"tools", "http", "simulator", "ros2", "worlds"},
    "tools": {"http", "simulator", "ros2", "worlds"},
    "http": {"simulator", "ros2", "worlds"},
    "simulator": {"tools", "http", "ros2"},
    "ros2": {"tools", "http", "worlds"},
    "worlds": {"motion", "tools", "http", "ros2"},
}
"""Room -> the rooms that it must not import. ROS's demo may use the simulator: it is the robot behind its topics."""


def module(file: Path) -> str:
    parts = file.relative_to(BACKEND.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(file: Path) -> set[str]:
    """The modules of the robot server that a file imports, anywhere in it."""
    modules = {module(other) for other in FILES}
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file} has a relative import, which this test cannot read"
            found |= {f"{node.module}.{alias.name}" for alias in node.names} | {str(node.module)}
    return {name for name in found & modules if not (ROBOT.parent / Path(*name.split(".")[1:])).is_dir()}


def room(name: str) -> str | None:
    """The room that a module stands in; None for the files at the top."""
    parts = name.removeprefix(f"{PACKAGE}.").split(".")
    return parts[0] if len(parts) > 1 else None


def test_this_test_reads_imports() -> None:
    assert f"{PACKAGE}.motion.safety" in imported(ROBOT / "motion" / "pilot.py")
    assert {room(module(file)) for file in FILES if file.name != "__init__.py"} == {None, *FORBIDDEN}


def test_no_files_import_each_other_in_a_circle() -> None:
    TopologicalSorter({module(file): imported(file) for file in FILES}).prepare()


@pytest.mark.parametrize("own", FORBIDDEN)
def test_a_room_imports_no_room_above_it(own: str) -> None:
    for file in (ROBOT / own).rglob("*.py"):
        assert not {room(name) for name in imported(file)} & FORBIDDEN[own], file


def test_only_the_choice_of_the_robot_and_the_demo_know_a_kind_of_robot() -> None:
    demo = ROBOT / "ros2" / "demo"
    for file in FILES:
        kinds = {room(name) for name in imported(file)} & {"simulator", "ros2"}
        own = {room(module(file))} if room(module(file)) in ("simulator", "ros2") else set()
        if file.parent == ROBOT / "worlds":
            own = {"simulator"}  # the built-in worlds are drawn with the legend that the simulated camera reads
        if file.name != "robots.py" and demo not in file.parents:
            assert kinds <= own, file


def test_only_the_process_knows_http() -> None:
    for file in FILES:
        if file.parent != ROBOT / "http" and file != ROBOT / "server.py":
            assert "http" not in {room(name) for name in imported(file)}, file


def test_only_the_ros_room_imports_ros() -> None:
    ros = {"rclpy", "nav2_msgs", "tf2_msgs", "geometry_msgs", "nav_msgs", "sensor_msgs", "std_msgs", "action_msgs"}
    for file in FILES:
        names: set[str] = set()
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                names.add(str(node.module).partition(".")[0])
        if ROBOT / "ros2" not in file.parents:
            assert not names & ros, file
