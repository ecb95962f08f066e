"""Telemetry tells of a motion that ended by itself until the next one begins."""

from __future__ import annotations

import asyncio
from pathlib import Path

from tests.mcp_robot.conftest import serving
from tests.mcp_robot.tools.test_tools import call, refused


async def test_a_motion_that_the_watchdog_ends_is_told_until_the_next_one_begins(tmp_path: Path) -> None:
    async with (
        serving(tmp_path, time_scale=1.0, limits={"unheard_motion": 4.0}) as robot,
        robot.mcp() as client,
        robot.telemetry("state", rate=50) as reader,
    ):
        assert (await reader.state()).halted is None
        sentence = await refused(client, "navigate_to_place", place="lab 2.3.7")
        halted = (await reader.state(lambda s: s.halted is not None)).halted
        assert halted is not None
        assert f"{halted.code}: {halted.text}" == sentence
        assert halted.code == "no_sign_of_life"
        assert (await reader.state(lambda s: s.motion is None and s.twist.linear == 0)).halted == halted
        await call(client, "rotate_in_place", degrees=5)
        await reader.state(lambda s: s.halted is None)


async def test_what_people_end_and_what_never_began_is_not_told_as_halted(tmp_path: Path) -> None:
    async with (
        serving(tmp_path, time_scale=1.0) as robot,
        robot.mcp() as client,
        robot.http() as http,
        robot.telemetry("state", rate=50) as reader,
    ):
        driving = asyncio.create_task(client.call_tool("navigate_to_place", {"place": "lab 2.3.7"}))
        await reader.state(lambda s: s.twist.linear > 0.1)
        driving.cancel()
        assert (await reader.state(lambda s: s.motion is None)).halted is None
        driving = asyncio.create_task(client.call_tool("navigate_to_place", {"place": "kitchen"}))
        await reader.state(lambda s: s.motion is not None)
        await http.post("/stop", params={"by": "Ana"})
        assert (await driving).is_error
        assert (await reader.state(lambda s: s.stop is not None and s.motion is None)).halted is None
        await refused(client, "navigate_to_place", place="dock")
        await http.post("/release")
        await refused(client, "navigate_to_pose", x=5.6, y=3.0)
        assert (await reader.state(lambda s: s.stop is None)).halted is None
