"""A robot offers the tools that it has the parts for, and no others; what cannot be done is an error."""

from __future__ import annotations

from pathlib import Path

import pytest

from backend import telemetry
from tests.mcp_robot.conftest import serving
from tests.mcp_robot.tools.test_tools import TOOLS


@pytest.mark.parametrize(("part", "tool"), [("camera", "take_photo"), ("voice", "speak")])
async def test_a_robot_without_a_part_has_no_tool_for_it(tmp_path: Path, part: str, tool: str) -> None:
    async with serving(tmp_path, simulator={part: False}) as robot, robot.mcp() as client:
        assert {each.name for each in (await client.list_tools()).tools} == TOOLS - {tool}
        assert (await client.call_tool(tool, {})).is_error


async def test_a_robot_without_a_camera_announces_no_pictures_and_sends_none(tmp_path: Path) -> None:
    async with serving(tmp_path, simulator={"camera": False}) as robot, robot.telemetry("camera", "state") as reader:
        states = 0
        while states < 5:
            message = await reader.next()
            assert not isinstance(message, telemetry.Picture)
            states += isinstance(message, telemetry.State)
