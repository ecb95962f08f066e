"""A way that was only computed is drawn for whoever gave it an id, until they take it back or anything moves."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any, cast

import pytest
from mcp import Client
from mcp_types import CallToolResult, RequestParamsMeta

from backend.telemetry import Path as Way
from tests.mcp_robot.conftest import Reader, Served, serving
from tests.mcp_robot.tools.test_tools import call, refused

KITCHEN, LAB = (2.9, 9.7), (11.8, 4.0)


async def computed(client: Client, place: str, **preview: Any) -> CallToolResult:
    """A call with `plan_only`, whose way is to be drawn as `preview` says."""
    meta = cast("RequestParamsMeta", {"robot-acp/preview": preview})
    result = await client.call_tool("navigate_to_place", {"place": place, "plan_only": True}, meta=meta)
    assert isinstance(result, CallToolResult)
    return result


async def drawn(client: Client, place: str, **preview: Any) -> None:
    result = await computed(client, place, **preview)
    assert not result.is_error, result.content


async def code_of(client: Client, place: str, **preview: Any) -> str:
    result = await computed(client, place, **preview)
    assert result.is_error
    return str((result.structured_content or {})["error"]["code"])


async def shown(reader: Reader, end: tuple[float, float]) -> None:
    """Wait for the way to `end` as a preview."""
    way = await reader.until(lambda m: isinstance(m, Way) and m.preview and m.points)
    assert way.points[-1] == pytest.approx(end, abs=0.01)


async def gone(reader: Reader) -> None:
    await reader.until(lambda m: isinstance(m, Way) and not m.points)


async def drawn_now(robot: Served) -> Way:
    """What a reader who comes now is shown."""
    async with robot.telemetry("path") as late:
        way = await late.until(lambda m: isinstance(m, Way))
        assert isinstance(way, Way)
        return way


async def test_a_preview_is_drawn_until_it_is_taken_back(robot: Served) -> None:
    async with robot.mcp() as client, robot.http() as http, robot.telemetry("path") as reader:
        await drawn(client, "kitchen", id="a.1")
        await shown(reader, KITCHEN)
        assert (await http.delete("/preview/a.1")).json() == {"preview": None}
        await gone(reader)


async def test_a_way_without_an_id_is_drawn_for_nobody(robot: Served) -> None:
    async with robot.mcp() as client:
        await drawn(client, "kitchen", id="a.1")
        await call(client, "navigate_to_place", place="lab 2.3.7", plan_only=True)
        for nonsense in ({}, {"id": ""}, {"id": 7}, {"id": "x" * 300}, {"id": "a/b"}):
            await drawn(client, "lab 2.3.7", **nonsense)
        way = await drawn_now(robot)
        assert way.points[-1] == pytest.approx(KITCHEN, abs=0.01)


async def test_nobody_takes_back_the_way_of_somebody_else(robot: Served) -> None:
    async with robot.mcp() as client, robot.http() as http:
        await drawn(client, "kitchen", id="a.1")
        assert (await http.delete("/preview/b.1")).json() == {"preview": "a.1"}
        assert (await drawn_now(robot)).preview
        assert (await http.delete("/preview")).status_code == 404
        assert (await drawn_now(robot)).preview


async def test_the_newest_is_drawn_and_the_one_before_does_not_come_back(robot: Served) -> None:
    async with robot.mcp() as client, robot.http() as http:
        await drawn(client, "kitchen", id="a.1")
        await drawn(client, "lab 2.3.7", id="b.1")
        await http.delete("/preview/a.1")
        assert (await drawn_now(robot)).points[-1] == pytest.approx(LAB, abs=0.01)
        await http.delete("/preview/b.1")
        assert not (await drawn_now(robot)).points


async def test_a_mere_look_is_not_drawn_over_the_way_that_people_are_asked_about(robot: Served) -> None:
    async with robot.mcp() as client, robot.http() as http:
        await drawn(client, "kitchen", id="a.1", rehearsal=True)
        await drawn(client, "lab 2.3.7", id="b.1")
        assert (await drawn_now(robot)).points[-1] == pytest.approx(KITCHEN, abs=0.01)
        await drawn(client, "lab 2.3.7", id="b.2", rehearsal=True)
        assert (await drawn_now(robot)).points[-1] == pytest.approx(LAB, abs=0.01)
        await http.delete("/preview/b.2")


async def test_a_preview_that_cannot_be_computed_leaves_none_of_another(robot: Served) -> None:
    async with robot.mcp() as client, robot.http() as http:
        await drawn(client, "kitchen", id="a.1")
        meta = cast("RequestParamsMeta", {"robot-acp/preview": {"id": "b.1"}})
        wall = {"x": 0.05, "y": 0.05, "plan_only": True}
        assert (await client.call_tool("navigate_to_pose", wall, meta=meta)).is_error
        assert not (await drawn_now(robot)).points
        assert (await http.delete("/preview/a.1")).json() == {"preview": None}


async def test_a_way_that_is_driven_is_not_taken_back(tmp_path: Path) -> None:
    async with (
        serving(tmp_path, time_scale=1.0) as robot,
        robot.mcp() as client,
        robot.http() as http,
        robot.telemetry("state", "path") as reader,
    ):
        await drawn(client, "lab 2.3.7", id="a.1")
        driving = asyncio.create_task(client.call_tool("navigate_to_place", {"place": "lab 2.3.7"}))
        await reader.state(lambda s: s.twist.linear > 0.1)
        assert (await http.delete("/preview/a.1")).json() == {"preview": None}
        way = await drawn_now(robot)
        assert way.points
        assert not way.preview
        await drawn(client, "kitchen", id="b.1")
        assert not (await drawn_now(robot)).preview
        driving.cancel()
        await gone(reader)


async def test_no_preview_outlives_the_begin_of_any_motion(robot: Served) -> None:
    async with robot.mcp() as client:
        await drawn(client, "kitchen", id="a.1")
        await call(client, "rotate_in_place", degrees=5)
        assert not (await drawn_now(robot)).points


async def test_a_drive_that_is_refused_leaves_the_preview_of_somebody_else(robot: Served) -> None:
    async with robot.mcp() as client, robot.http() as http:
        await drawn(client, "kitchen", id="a.1")
        await http.post("/stop", params={"by": "Ana"})
        assert (await refused(client, "navigate_to_place", place="lab 2.3.7")).startswith("stopped: ")
        assert (await drawn_now(robot)).preview
        await http.post("/release")


async def test_a_rehearsal_is_refused_for_what_the_drive_would_be(tmp_path: Path) -> None:
    async with (
        serving(tmp_path, time_scale=1.0) as robot,
        robot.mcp() as client,
        robot.http() as http,
        robot.telemetry("state") as reader,
    ):
        await drawn(client, "kitchen", id="a.1", rehearsal=True)
        driving = asyncio.create_task(client.call_tool("navigate_to_place", {"place": "lab 2.3.7"}))
        await reader.state(lambda s: s.motion is not None)
        assert await code_of(client, "kitchen", id="a.2", rehearsal=True) == "busy"
        driving.cancel()
        await reader.state(lambda s: s.motion is None)
        await http.post("/stop", params={"by": "Ana"})
        assert await code_of(client, "kitchen", id="a.3", rehearsal=True) == "stopped"
        await drawn(client, "kitchen", id="a.4")  # a mere look is always answered
        await http.post("/release")


async def test_a_rehearsal_looks_at_the_battery(tmp_path: Path) -> None:
    async with serving(tmp_path, limits={"battery_floor": 0.99}) as robot, robot.mcp() as client:
        assert await code_of(client, "kitchen", id="a.1", rehearsal=True) == "battery_low"
        await drawn(client, "dock", id="a.2", rehearsal=True)


async def test_the_drives_say_that_their_flag_moves_nothing(robot: Served) -> None:
    async with robot.mcp() as client:
        told = {tool.name: (tool.meta or {}).get("robot-acp/preview") for tool in (await client.list_tools()).tools}
    assert {name for name, flag in told.items() if flag} == {"navigate_to_place", "navigate_to_pose"}
    assert told["navigate_to_place"] == "plan_only"
