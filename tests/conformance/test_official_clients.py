"""The official SDKs as clients run the paper's session; in Chromium: tests/end_to_end/test_third_party_page.py."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from backend.identity import Role
from tests.conformance.papers_session import run_the_papers_session
from tests.conformance.sdk_clients import PythonClient, TypeScriptInNode
from tests.processes import Robot


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """A robot that takes its time: the session has a cancel on the way."""
    with Robot(tmp_path_factory.mktemp("data")).at_work("--time-scale", "4") as robot:
        yield robot


@pytest.mark.parametrize("sdk", [TypeScriptInNode, PythonClient])
async def test_an_official_sdk_runs_the_papers_session(
    robot: Robot, sdk: type[TypeScriptInNode] | type[PythonClient]
) -> None:
    address = f"ws://127.0.0.1:{robot.bridge_port}/acp"
    async with sdk.open(address, robot.token("Ana", Role.SUPERVISOR)) as client:
        await run_the_papers_session(client, robot, "Ana")
