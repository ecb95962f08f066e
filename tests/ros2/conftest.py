"""Real ROS nodes: the stand-in in its own process, the robot server in this one, and others who speak to Nav2 too."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.mcp_robot.conftest import Served, served
from tests.ros2_robots import UNFIT, StandIn, StandIns


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if UNFIT and Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.skip(reason=UNFIT))


@pytest.fixture(scope="session")
def stand_ins(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[StandIns]:
    assert request.config.cache is not None
    stand_ins = StandIns(tmp_path_factory.mktemp("stand-ins"), request.config.cache)
    yield stand_ins
    stand_ins.close()


@pytest.fixture
def interfaces(stand_ins: StandIns, tmp_path: Path) -> Path:
    """A data folder with ROS interfaces, which this process can import."""
    from backend.mcp_robot.ros2 import interfaces

    stand_ins.share(tmp_path)
    interfaces.provide(tmp_path, "kilted")
    return tmp_path


@pytest.fixture
def start_at_once(interfaces: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait for five seconds at most for the robot's parts: in the test that takes this, some never come."""
    from backend.mcp_robot.ros2 import ros2_robot

    monkeypatch.setattr(ros2_robot, "START_LIMIT", 5.0)


class Setting:
    """A stand-in, and robot servers for it with settings of their own."""

    def __init__(self, data: Path, stand_in: StandIn) -> None:
        self.data = data
        self.stand_in = stand_in
        self.domain = stand_in.domain

    @contextlib.asynccontextmanager
    async def served(self, *, limits: dict[str, Any] | None = None, **ros2: Any) -> AsyncIterator[Served]:
        settings = {"demo": True, "domain_id": self.domain, "answer_timeout": 1.0, **ros2}
        async with served(self.data, kind="ros2", ros2=settings, limits=limits or {}) as robot:
            yield robot


@pytest.fixture
def real_time(stand_ins: StandIns, interfaces: Path) -> Iterator[Setting]:
    """A stand-in at the robot's real speed."""
    with stand_ins.one("--time-scale", "1.0") as stand_in:
        yield Setting(interfaces, stand_in)


@contextlib.asynccontextmanager
async def node(domain: int) -> AsyncIterator[Any]:
    """Another ROS node on the same domain; entities are made inside, before its thread starts."""
    from backend.mcp_robot.ros2.link import RosLink

    link = RosLink("somebody_else", domain)
    try:
        yield link
    finally:
        await asyncio.to_thread(link.close)
