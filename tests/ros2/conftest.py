"""Real ROS nodes: the stand-in in its own process, the robot server in this one, and others who speak to Nav2 too."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from backend.mcp_robot.ros2.waiting import Waits
from tests.mcp_robot.conftest import UNHURRIED, Served, served
from tests.ros2_robots import PATIENT, UNFIT, WAITS, StandIn, StandIns


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if UNFIT and Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.skip(reason=UNFIT))


@pytest.fixture(scope="session")
def stand_ins(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StandIns]:
    stand_ins = StandIns(tmp_path_factory.mktemp("stand-ins"))
    yield stand_ins
    stand_ins.close()


@pytest.fixture(scope="session", autouse=True)
def generated(tmp_path_factory: pytest.TempPathFactory) -> None:
    """The ROS interfaces are there before any test begins: the time limit of a command is not for generating them."""
    from backend.mcp_robot.ros2 import interfaces

    interfaces.generated(tmp_path_factory.mktemp("interfaces"), "kilted")


@pytest.fixture
def interfaces(tmp_path: Path) -> Path:
    """A data folder; this process can import the ROS interfaces."""
    from backend.mcp_robot.ros2 import interfaces

    interfaces.provide(tmp_path, "kilted")
    return tmp_path


@pytest.fixture
def never(interfaces: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Names parts of the robot that never come in this test: a start does not wait for them, and for all others."""
    from backend.mcp_robot.ros2.ros2_robot import Ros2Robot

    absent = Ros2Robot._absent

    def name(*parts: str) -> None:
        monkeypatch.setattr(Ros2Robot, "_absent", lambda robot: [p for p in absent(robot) if not p.startswith(parts)])

    return name


class Setting:
    """A stand-in, and robot servers for it with settings of their own."""

    def __init__(self, data: Path, stand_in: StandIn) -> None:
        self.data = data
        self.stand_in = stand_in
        self.domain = stand_in.domain

    @contextlib.asynccontextmanager
    async def served(
        self, *, limits: dict[str, Any] | None = None, waits: Waits = WAITS, **ros2: Any
    ) -> AsyncIterator[Served]:
        settings = PATIENT | {"demo": True, "domain_id": self.domain} | ros2
        limits = UNHURRIED | (limits or {})
        async with served(self.data, waits=waits, kind="ros2", ros2=settings, limits=limits) as robot:
            yield robot


@pytest.fixture
def real_time(stand_ins: StandIns, interfaces: Path) -> Iterator[Setting]:
    """A stand-in at the robot's real speed."""
    with stand_ins.one("--time-scale", "1.0") as stand_in:
        yield Setting(interfaces, stand_in)


@contextlib.asynccontextmanager
async def node(domain: int, name: str = "somebody_else") -> AsyncIterator[Any]:
    """Another ROS node on the same domain; entities are made inside, before its thread starts."""
    from backend.mcp_robot.ros2.ros_thread import RosThread

    link = RosThread(name, domain)
    try:
        yield link
    finally:
        await asyncio.to_thread(link.close)
