"""The connection to an MCP server while many use it at once."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from typing import Any

import mcp_types as types
import pytest
from mcp.server.lowlevel import Server

from backend.agent.acp.abilities import Abilities
from backend.agent.robot.mcp_client import MAX_READINGS, McpClient, ServerUnavailable
from tests.processes import eventually


class Slow(McpClient):
    """The connection to a server in this process. Its tool `look` only reads and `drive` acts; both last until told."""

    def __init__(self) -> None:
        super().__init__("http://127.0.0.1:1/mcp", absent="The robot does not answer.")
        self.may_end = asyncio.Event()
        self.running = {"look": 0, "drive": 0}
        self.looks = 0
        self.most_looks = 0
        self.is_there = True

    @contextlib.asynccontextmanager
    async def _transport(self) -> AsyncIterator[Any]:
        if not self.is_there:
            raise OSError
        yield Server("slow", on_list_tools=self._list, on_call_tool=self._answer)

    async def _list(self, *_: Any) -> types.ListToolsResult:
        reads = types.ToolAnnotations(read_only_hint=True)
        schema = {"type": "object"}
        look = types.Tool(name="look", input_schema=schema, annotations=reads)
        return types.ListToolsResult(tools=[look, types.Tool(name="drive", input_schema=schema)])

    async def _answer(self, _: Any, params: types.CallToolRequestParams) -> types.CallToolResult:
        self.running[params.name] += 1
        self.looks += params.name == "look"
        self.most_looks = max(self.most_looks, self.running["look"])
        try:
            await self.may_end.wait()
        finally:
            self.running[params.name] -= 1
        places = {"nodes": [{"name": "kitchen", "type": "space"}]}
        return types.CallToolResult(content=[], structured_content=places)


@pytest.fixture
async def robot() -> AsyncIterator[Slow]:
    robot = Slow()
    yield robot
    robot.may_end.set()
    await robot.close()


async def test_few_readings_run_at_once_and_none_delays_a_call_that_acts(robot: Slow) -> None:
    await robot.tools()
    readings = [asyncio.create_task(robot.call("look", {})) for _ in range(50)]
    await eventually(lambda: robot.running["look"] == MAX_READINGS, "the first readings")
    drive = asyncio.create_task(robot.call("drive", {}))
    await eventually(lambda: robot.running["drive"] == 1, "the drive")
    drive.cancel()
    await eventually(lambda: robot.running["drive"] == 0, "its end")
    robot.may_end.set()
    answers = await asyncio.gather(*readings)
    assert not any(answer.failed for answer in answers)
    assert robot.most_looks == MAX_READINGS


async def test_a_reading_that_is_cancelled_makes_room_for_the_next(robot: Slow) -> None:
    await robot.tools()
    readings = [asyncio.create_task(robot.call("look", {})) for _ in range(2 * MAX_READINGS)]
    await eventually(lambda: robot.looks == MAX_READINGS, "the first readings")
    for reading in readings[:MAX_READINGS]:
        reading.cancel()
    await eventually(lambda: robot.looks == 2 * MAX_READINGS, "the others")
    for reading in readings:
        reading.cancel()
    await asyncio.gather(*readings, return_exceptions=True)


async def test_however_many_ask_for_the_abilities_the_robot_is_asked_once(robot: Slow) -> None:
    abilities = Abilities(robot, "look")
    asking = [asyncio.create_task(abilities.read()) for _ in range(50)]
    await eventually(lambda: robot.looks == 1, "the reading")
    asking[0].cancel()  # whoever asked first may leave
    robot.may_end.set()
    answers = await asyncio.gather(*asking[1:])
    assert {"name": "kitchen", "type": "space"} in answers[0]["places"]
    assert robot.looks == 1
    await abilities.read()
    assert robot.looks == 2


async def test_whoever_asks_for_the_abilities_of_an_absent_robot_is_told_and_the_next_one_asks_again(
    robot: Slow,
) -> None:
    robot.is_there = False
    abilities = Abilities(robot, "look")
    told = await asyncio.gather(*(abilities.read() for _ in range(3)), return_exceptions=True)
    assert [type(one) for one in told] == [ServerUnavailable] * 3
    robot.is_there = True
    robot.may_end.set()
    assert (await abilities.read())["places"] == [{"name": "kitchen", "type": "space"}]
