"""A real robot server, a real agent and a real bridge, each in its own process."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.processes import Robot


@pytest.fixture(scope="session")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """All three at work."""
    robot = Robot(tmp_path_factory.mktemp("data"))
    with (
        robot.running("robot", "--time-scale", "10", port=robot.robot_port),
        robot.running("agent", port=robot.agent_port),
        robot.running("bridge", port=robot.bridge_port),
    ):
        yield robot


@pytest.fixture
def alone(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Settings and a data folder with no process behind them."""
    return Robot(tmp_path_factory.mktemp("alone"))
