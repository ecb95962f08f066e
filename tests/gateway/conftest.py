"""A real robot server, a real agent and a real bridge, each in its own process."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.processes import Robot


@pytest.fixture(scope="session")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """All three at work."""
    with Robot(tmp_path_factory.mktemp("data")).at_work("--time-scale", "10") as robot:
        yield robot


@pytest.fixture
def alone(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Settings and a data folder with no process behind them."""
    return Robot(tmp_path_factory.mktemp("alone"))
