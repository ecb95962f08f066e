"""The tools, through a real MCP client over HTTP against a real server."""

from __future__ import annotations

import asyncio
import base64
import io
import math
import wave
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from mcp_types import AudioContent, CallToolResult, ImageContent, TextContent
from PIL import Image

from backend import telemetry
from tests.mcp_robot.conftest import Served, serving

TOOLS = {
    "get_topological_map",
    "get_current_pose",
    "get_robot_status",
    "take_photo",
    "navigate_to_pose",
    "navigate_to_place",
    "rotate_in_place",
    "speak",
}
AT_ONCE = 1.0
"""Metres within which it halts, of a drive of 13 m: where robot and server are two processes, a busy machine lets one
of them wait for the other."""
LOOKING = {"get_topological_map", "get_current_pose", "get_robot_status", "take_photo"}


async def call(client: Client, tool: str, **arguments: Any) -> dict[str, Any]:
    result = await client.call_tool(tool, arguments)
    assert isinstance(result, CallToolResult)
    assert not result.is_error, result.content
    assert result.structured_content is not None
    return result.structured_content


async def refused(client: Client, tool: str, **arguments: Any) -> str:
    """The text of the tool error that a call ends with."""
    result = await client.call_tool(tool, arguments)
    assert result.is_error
    content = result.content[0]
    assert isinstance(content, TextContent)
    error = (result.structured_content or {})["error"]
    assert content.text == f"{error['code']}: {error['message']}"
    return content.text


def apart(a: dict[str, Any], b: dict[str, Any]) -> float:
    return math.hypot(a["x"] - b["x"], a["y"] - b["y"])


async def test_all_tools_are_listed_with_title_annotations_and_a_schema_for_their_result(robot: Served) -> None:
    async with robot.mcp() as client:
        tools = {tool.name: tool for tool in (await client.list_tools()).tools}
    assert set(tools) == TOOLS
    for name, tool in tools.items():
        hints = tool.annotations
        assert hints is not None
        assert None not in (hints.destructive_hint, hints.idempotent_hint, hints.open_world_hint)
        assert hints.read_only_hint == (name in LOOKING)
        assert tool.title
        assert tool.description
        assert tool.output_schema
        assert tool.input_schema["additionalProperties"] is False
        title = (tool.meta or {})["robot-acp/title"]
        required = tool.input_schema.get("required", [])
        assert "{" not in title.format(**dict.fromkeys(required, "1"))


async def test_the_map_names_every_place_with_type_and_position(robot: Served) -> None:
    async with robot.mcp() as client:
        found = await call(client, "get_topological_map")
    assert found["frame_id"] == "map"
    dock = next(node for node in found["nodes"] if node["type"] == "docking")
    assert dock["name"] == "dock"
    assert set(dock["position"]) == {"x", "y", "yaw"}
    ids = {node["id"] for node in found["nodes"]}
    assert len(ids) == 13
    assert all(edge["source"] in ids and edge["target"] in ids for edge in found["edges"])


async def test_the_robot_starts_at_its_dock_charging_and_at_rest(robot: Served) -> None:
    async with robot.mcp() as client:
        pose = await call(client, "get_current_pose")
        status = await call(client, "get_robot_status")
    assert pose["nearest_place"] == "dock"
    assert pose["frame_id"] == "map"
    assert not pose["stale"]
    assert status["mode"] == "idle"
    assert status["charging"]
    assert 0 < status["battery"] <= 1
    assert (status["moving"], status["stopped"], status["goal"]) == (False, None, None)


async def test_driving_to_a_place_arrives_there_and_tells_progress_on_the_way(tmp_path: Path) -> None:
    heard: list[tuple[float, float | None, str | None]] = []

    async def on_progress(progress: float, total: float | None, message: str | None) -> None:
        heard.append((progress, total, message))

    async with serving(tmp_path, time_scale=4.0) as robot, robot.mcp() as client:
        nodes = (await call(client, "get_topological_map"))["nodes"]
        place = next(node for node in nodes if node["name"] == "lab 2.3.7")
        result = await client.call_tool("navigate_to_place", {"place": "Lab2.3.7"}, progress_callback=on_progress)
        pose = await call(client, "get_current_pose")
    assert not result.is_error
    arrived = result.structured_content or {}
    assert arrived["reached"]
    assert arrived["place"] == "lab 2.3.7"
    assert apart(arrived["pose"], place["position"]) < 0.1
    assert apart(pose, place["position"]) < 0.1
    assert abs(math.remainder(pose["yaw"] - place["position"]["yaw"], math.tau)) < 0.05
    assert 11 <= arrived["distance"] <= 16.5
    assert arrived["distance"] == pytest.approx(arrived["path_length"], rel=0.05)
    assert arrived["duration_s"] == pytest.approx(arrived["expected_s"], rel=0.2)
    fractions = [progress for progress, _, _ in heard]
    assert len(fractions) >= 3
    assert fractions == sorted(fractions)
    assert all(0 <= progress <= 1 and total == 1 for progress, total, _ in heard)
    assert (heard[0][2] or "").endswith(" s")
    assert " m to go, about " in (heard[0][2] or "")


async def test_driving_to_a_pose_takes_up_its_yaw(tmp_path: Path) -> None:
    async with serving(tmp_path, time_scale=4.0) as robot, robot.mcp() as client:
        result = await call(client, "navigate_to_pose", x=3.0, y=2.5, yaw=-2.0)
    assert result["reached"]
    assert apart(result["pose"], {"x": 3.0, "y": 2.5}) < 0.1
    assert result["pose"]["yaw"] == pytest.approx(-2.0, abs=0.05)
    assert result["place"] is None


async def test_plan_only_computes_the_path_and_moves_nothing(robot: Served) -> None:
    async with robot.mcp() as client, robot.telemetry("state") as reader:
        before = (await reader.state()).pose
        result = await call(client, "navigate_to_place", place="kitchen", plan_only=True)
        assert not result["reached"]
        assert (result["distance"], result["duration_s"]) == (0, 0)
        assert result["path_length"] > 5
        for _ in range(5):
            state = await reader.state()
            assert state.pose == before
            assert state.motion is None


@pytest.mark.parametrize("degrees", [90.0, -45.0, 360.0])
async def test_turning_turns_by_the_degrees_asked_left_positive(robot: Served, degrees: float) -> None:
    async with robot.mcp() as client:
        before = await call(client, "get_current_pose")
        result = await call(client, "rotate_in_place", degrees=degrees)
    turned = math.degrees(result["pose"]["yaw"] - before["yaw"])
    assert math.remainder(turned - degrees, 360) == pytest.approx(0, abs=1.0)
    assert apart(result["pose"], before) < 0.01


async def test_a_photo_is_a_picture_with_its_size_and_pose(robot: Served) -> None:
    async with robot.mcp() as client:
        result = await client.call_tool("take_photo", {})
    facts = result.structured_content or {}
    content = result.content[0]
    assert isinstance(content, ImageContent)
    assert content.mime_type == "image/jpeg"
    with Image.open(io.BytesIO(base64.b64decode(content.data))) as image:
        assert image.size == (facts["width"], facts["height"]) == (640, 480)
    assert apart(facts["pose"], {"x": 0.9, "y": 3.1}) < 0.01


async def test_speaking_takes_as_long_as_its_sound_on_the_robots_clock(robot: Served) -> None:
    async with robot.mcp() as client, robot.telemetry("state", "speech") as reader:
        before = (await reader.state()).time
        result = await client.call_tool("speak", {"text": "The meeting is at noon."})
        begun = await reader.until(lambda m: hasattr(m, "text"))
        after = (await reader.state(lambda s: s.speaking is None and s.time > begun.time)).time
    facts = result.structured_content or {}
    assert facts["text"] == begun.text == "The meeting is at noon."
    content = result.content[0]
    assert isinstance(content, AudioContent)
    assert content.mime_type == "audio/wav"
    with wave.open(io.BytesIO(base64.b64decode(content.data))) as sound:
        seconds = sound.getnframes() / sound.getframerate()
    assert seconds == pytest.approx(facts["seconds"], abs=0.01)
    assert seconds == pytest.approx(begun.seconds)
    assert after - before >= seconds


@pytest.mark.parametrize(
    ("tool", "arguments", "text"),
    [
        ("navigate_to_place", {"place": "lab 9"}, "unknown_place: No place called lab 9. Known places: lab 2.3.9, "),
        ("navigate_to_pose", {"x": 5.6, "y": 3.0}, "occupied: The goal (5.6, 3.0) is inside a wall"),
        ("navigate_to_pose", {"x": 5.6, "y": 3.0, "plan_only": True}, "occupied: "),
        ("navigate_to_pose", {"x": 99, "y": 0}, "outside_map: The goal (99.0, 0.0) is outside the map"),
        ("navigate_to_pose", {"x": 1}, "bad_arguments: y: field required."),
        ("navigate_to_pose", {"x": "near", "y": 2}, "bad_arguments: x: input should be a valid number"),
        ("navigate_to_pose", {"x": "1.5", "y": 2}, "bad_arguments: x: input should be a valid number"),
        ("navigate_to_pose", {"x": True, "y": 2}, "bad_arguments: x: input should be a valid number"),
        ("navigate_to_pose", {"x": 1, "y": 2, "z": 3}, "bad_arguments: z: extra inputs are not permitted"),
        ("navigate_to_place", {"place": "dock", "plan_only": "yes"}, "bad_arguments: plan_only: "),
        ("navigate_to_place", {"place": "dock", "plan_only": 1}, "bad_arguments: plan_only: "),
        ("speak", {"text": 7}, "bad_arguments: text: "),
        ("take_photo", {"zoom": 2}, "bad_arguments: zoom: extra inputs are not permitted"),
        ("rotate_in_place", {"degrees": 1e9}, "too_long: "),
        ("speak", {"text": "x" * 401}, "too_long: The text has 401 characters"),
        ("speak", {"text": " "}, "empty: "),
    ],
)
async def test_what_cannot_be_done_is_refused_with_a_code_and_a_sentence(
    robot: Served, tool: str, arguments: dict[str, Any], text: str
) -> None:
    async with robot.mcp() as client:
        assert (await refused(client, tool, **arguments)).startswith(text)
        assert (await call(client, "get_robot_status"))["mode"] == "idle"


async def test_a_number_that_is_none_is_refused_even_when_json_lets_it_through(robot: Served) -> None:
    async with robot.mcp() as client:
        listed = (await client.list_tools()).tools
        assert listed
    request = {
        "jsonrpc": "2.0",
        "id": 1,
        "method": "initialize",
        "params": {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "raw", "version": "1"}},
    }
    headers = {"Accept": "application/json, text/event-stream", "Content-Type": "application/json"}
    async with robot.http() as http:
        hello = await http.post("/mcp", json=request, headers=headers)
        headers["mcp-session-id"] = hello.headers["mcp-session-id"]
        ready = '{"jsonrpc": "2.0", "method": "notifications/initialized"}'
        await http.post("/mcp", content=ready, headers=headers)
        body = (
            '{"jsonrpc": "2.0", "id": 2, "method": "tools/call", "params": {"name": "navigate_to_pose", "arguments": '
        )
        answer = await http.post("/mcp", content=body + '{"x": 1e999, "y": 1}}}', headers=headers)
    assert "not_finite: x must be an ordinary number" in answer.text


async def test_motions_and_speeches_are_not_begun_too_often(tmp_path: Path) -> None:
    limits = {"max_motions_per_minute": 2, "max_speeches_per_minute": 1}
    async with serving(tmp_path, time_scale=4.0, limits=limits) as robot, robot.mcp() as client:
        for _ in range(2):
            await call(client, "rotate_in_place", degrees=1)
        text = await refused(client, "rotate_in_place", degrees=1)
        assert text.startswith(
            "too_often: 2 motions were begun within a minute, the most that is allowed. Ask again in "
        )
        await call(client, "speak", text="Yes")
        assert (await refused(client, "speak", text="No")).startswith("too_often: 1 speeches were begun")


async def test_one_motion_at_a_time_and_looking_is_always_possible(tmp_path: Path) -> None:
    async with serving(tmp_path, time_scale=1.0) as robot, robot.mcp() as client, robot.telemetry("state") as reader:
        driving = asyncio.create_task(client.call_tool("navigate_to_place", {"place": "lab 2.3.7"}))
        await reader.state(lambda s: s.twist.linear > 0.1)
        for tool, arguments in (("rotate_in_place", {"degrees": 10}), ("navigate_to_place", {"place": "dock"})):
            text = await refused(client, tool, **arguments)
            assert text.startswith("busy: The robot is driving to lab 2.3.7 already.")
        status = await call(client, "get_robot_status")
        assert status["mode"] == "driving"
        assert status["moving"]
        assert status["goal"]["place"] == "lab 2.3.7"
        assert status["goal"]["distance_left"] > 10
        await call(client, "navigate_to_place", place="dock", plan_only=True)
        driving.cancel()


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_cancelling_the_call_brings_the_robot_to_a_halt_on_the_way(tmp_path: Path, mode: str) -> None:
    async with (
        serving(tmp_path, time_scale=1.0) as robot,
        robot.mcp(mode) as client,
        robot.telemetry("state", rate=50) as reader,
    ):
        driving = asyncio.create_task(client.call_tool("navigate_to_place", {"place": "lab 2.3.7"}))
        await reader.state(lambda s: s.twist.linear > 0.4 and s.pose.x > 1.3)
        driving.cancel()
        moving = await reader.state(lambda s: s.motion is None)
        halted = await reader.state(lambda s: s.twist == telemetry.Twist(0.0, 0.0))
        assert math.dist((halted.pose.x, halted.pose.y), (moving.pose.x, moving.pose.y)) < AT_ONCE
        assert 0.3 < apart({"x": halted.pose.x, "y": halted.pose.y}, {"x": 0.9, "y": 3.1}) < 3
        for _ in range(10):
            assert (await reader.state()).pose == halted.pose
        await reader.subscribe("path")
        assert (await reader.until(lambda m: hasattr(m, "points"))).points == []
        assert (await call(client, "rotate_in_place", degrees=5))["reached"]


async def test_cancelling_speech_ends_it_and_leaves_the_motion_alone(tmp_path: Path) -> None:
    async with serving(tmp_path, time_scale=1.0) as robot, robot.mcp() as client, robot.telemetry("state") as reader:
        driving = asyncio.create_task(client.call_tool("navigate_to_place", {"place": "lab 2.3.7"}))
        await reader.state(lambda s: s.twist.linear > 0.1)
        speaking = asyncio.create_task(client.call_tool("speak", {"text": "A long story. " * 20}))
        await reader.state(lambda s: s.speaking is not None)
        speaking.cancel()
        state = await reader.state(lambda s: s.speaking is None)
        assert state.motion is not None
        await reader.state(lambda s: s.twist.linear > 0.1)
        assert not driving.done()
        driving.cancel()


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_a_client_whose_connection_breaks_leaves_no_robot_driving(tmp_path: Path, mode: str) -> None:
    async with serving(tmp_path, time_scale=1.0) as robot, robot.telemetry("state") as reader:
        process = await asyncio.create_subprocess_exec(
            *(str(part) for part in client_process(robot, mode)), stdout=asyncio.subprocess.DEVNULL
        )
        await reader.state(lambda s: s.twist.linear > 0.1)
        process.kill()
        await process.wait()
        halted = await reader.state(lambda s: s.motion is None and s.twist.linear == 0)
        assert math.hypot(halted.pose.x - 11.8, halted.pose.y - 4.0) > 5


def client_process(robot: Served, mode: str) -> tuple[Any, ...]:
    import sys

    code = """
import asyncio, sys
from mcp import Client
from mcp.client.streamable_http import streamable_http_client
from mcp.shared._httpx_utils import create_mcp_http_client

async def main(url, token, mode):
    async with create_mcp_http_client(headers={"Authorization": "Bearer " + token}) as http:
        async with Client(streamable_http_client(url, http_client=http), mode=mode) as client:
            await client.call_tool("navigate_to_place", {"place": "lab 2.3.7"})

asyncio.run(main(*sys.argv[1:]))
"""
    return sys.executable, "-c", code, f"{robot.url}/mcp", robot.token, mode


async def test_below_the_battery_floor_it_moves_to_the_dock_alone(tmp_path: Path) -> None:
    async with serving(tmp_path, limits={"battery_floor": 0.99}) as robot, robot.mcp() as client:
        for tool, arguments in (("navigate_to_place", {"place": "kitchen"}), ("rotate_in_place", {"degrees": 9})):
            assert (await refused(client, tool, **arguments)).startswith("battery_low: The battery is at 9")
        assert (await call(client, "navigate_to_place", place="dock"))["reached"]
