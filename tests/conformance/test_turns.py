"""Conformance: prompts, what they bring about, and what the agent asks while it works."""

from __future__ import annotations

import base64
import json
from io import BytesIO

import pytest
from PIL import Image

from tests.conformance.cases import shows
from tests.conformance.conftest import Opener
from tests.conformance.recorded_client import LONG, RecordedClient, choose
from tests.processes import Robot

pytestmark = pytest.mark.asyncio(loop_scope="module")


@shows("session/prompt text")
async def test_session_prompt(robot: Robot, client: RecordedClient) -> None:
    await client.new()
    async with robot.watched() as watched:
        assert await client.prompt("say that the meeting is at noon") == "end_turn"
        assert watched.spoken == ["The meeting is at noon."]
    # The robot's telemetry, which this client wants, may come after the answer: only answers are looked at.
    assert [frame["result"] for _, frame in client.log if "result" in frame][-1] == {"stopReason": "end_turn"}


@shows("session/prompt image")
async def test_session_prompt_with_an_image(client: RecordedClient) -> None:
    picture = BytesIO()
    Image.new("RGB", (8, 8), "red").save(picture, "PNG")
    block = {"type": "image", "mimeType": "image/png", "data": base64.b64encode(picture.getvalue()).decode()}
    await client.new()
    assert await client.prompt("where are you?", block) == "end_turn"
    await client.open_again("session/load")
    assert [u["content"] for u in client.updates("user_message_chunk")][1] == block


@shows("session/prompt resource", "session/prompt resource_link")
async def test_session_prompt_with_a_resource(client: RecordedClient) -> None:
    text = {"uri": "file:///notes.txt", "mimeType": "text/plain", "text": "The meeting is at noon."}
    embedded = {"type": "resource", "resource": text}
    link = {"type": "resource_link", "uri": "https://example.org/plan.pdf", "name": "plan.pdf"}
    await client.new()
    assert await client.prompt("where are you?", embedded, link) == "end_turn"
    await client.open_again("session/load")
    assert [u["content"] for u in client.updates("user_message_chunk")][1:] == [embedded, link]


@shows("session/cancel")
async def test_session_cancel(robot: Robot, client: RecordedClient) -> None:
    await client.new()
    async with robot.watched() as watched:
        turn = client.later(client.prompt(LONG))
        await watched.until(lambda: watched.speed, "the robot to drive")
        await client.notify("session/cancel", {"sessionId": client.session})
        assert await turn == "cancelled"
        assert await robot.stands()
    assert client.updates("tool_call_update")[-1]["status"] == "failed"


@shows("session/request_permission")
async def test_session_request_permission(robot: Robot, client: RecordedClient) -> None:
    await client.new()
    client.answers["session/request_permission"] = choose("reject_once")
    async with robot.watched() as watched:
        assert await client.prompt("say hello") == "end_turn"
        assert watched.spoken == []
    (question,) = client.heard("session/request_permission")
    announced = client.updates("tool_call")[-1]
    assert question["params"]["toolCall"]["toolCallId"] == announced["toolCallId"]
    kinds = [option["kind"] for option in question["params"]["options"]]
    assert kinds == ["allow_once", "allow_always", "reject_once", "reject_always"]
    assert client.updates("tool_call_update")[-1]["status"] == "failed"


@shows("session/update user_message_chunk")
async def test_session_update_user_message_chunk(client: RecordedClient) -> None:
    await client.new()
    await client.prompt("where are you?")
    assert client.updates("user_message_chunk") == []
    await client.open_again("session/load")
    (message,) = client.updates("user_message_chunk")
    assert message["content"] == {"type": "text", "text": "where are you?"}
    assert message["_meta"]["robot-acp/by"] in ("local", "Ana")


@shows("session/update agent_thought_chunk", "session/update agent_message_chunk")
async def test_session_update_agent_message_chunk(client: RecordedClient) -> None:
    await client.new()
    await client.prompt("where are you?")
    kinds = [update["sessionUpdate"] for number, update in client.events if number is not None]
    assert kinds[0] == "agent_thought_chunk"
    assert "agent_message_chunk" in kinds
    assert client.said


@shows("session/update tool_call", "session/update tool_call_update")
async def test_session_update_tool_call(client: RecordedClient) -> None:
    await client.new()
    await client.prompt("turn left by 20 degrees")
    (call,) = client.updates("tool_call")
    assert (call["kind"], call["status"], call["rawInput"]) == ("execute", "pending", {"degrees": 20})
    changes = client.updates("tool_call_update")
    assert {change["toolCallId"] for change in changes} == {call["toolCallId"]}
    assert [change["status"] for change in changes if "status" in change] == ["in_progress", "completed"]
    assert "rawOutput" in changes[-1]


@shows("session/update plan")
async def test_session_update_plan(client: RecordedClient) -> None:
    await client.new()
    await client.prompt("turn left by 20 degrees and then turn right by 20 degrees")
    plans = [[entry["status"] for entry in plan["entries"]] for plan in client.updates("plan")]
    assert plans[0] == ["in_progress", "pending"]
    assert plans[-1] == ["completed", "completed"]


@shows("session/update session_info_update")
async def test_session_update_session_info_update(client: RecordedClient) -> None:
    await client.new()
    await client.prompt("where are you?")
    named, ended = client.updates("session_info_update")
    assert named["title"] == "where are you?"
    assert ended["_meta"]["robot-acp/turn"]["stopReason"] == "end_turn"
    listed = (await client.request("session/list", {}))["sessions"][0]
    assert (listed["sessionId"], listed["title"]) == (client.session, "where are you?")


@shows("session/update usage_update")
async def test_session_update_usage_update(client: RecordedClient) -> None:
    await client.new()
    await client.prompt("where are you?")
    (usage,) = client.updates("usage_update")
    assert 0 < usage["used"] < usage["size"]


@shows("session/update available_commands_update")
async def test_session_update_available_commands_update(client: RecordedClient) -> None:
    await client.new()
    await client.hear("session/update")
    (update,) = client.updates("available_commands_update")
    names = {command["name"] for command in update["availableCommands"]}
    assert names == {"stop", "home", "where", "battery", "photo", "places", "export"}


@shows("available command /stop")
async def test_command_stop(robot: Robot, client: RecordedClient) -> None:
    await client.new()
    async with robot.watched() as watched:
        try:
            await client.prompt("/stop")
            await watched.until(lambda: watched.state.stop, "the stop")
        finally:
            await client.request("_robot/release", {})


@shows("available command /home")
async def test_command_home(robot: Robot, client: RecordedClient) -> None:
    async with robot.watched() as watched:
        start = watched.state.pose
        await client.new()
        await client.prompt("go to the kitchen")
        assert watched.distance_to(start.x, start.y) > 1
        await client.prompt("/home")
        assert watched.distance_to(start.x, start.y) < 0.3


@shows("available command /where")
async def test_command_where(client: RecordedClient) -> None:
    await client.new()
    await client.prompt("/where")
    assert "I am at" in client.said


@shows("available command /battery")
async def test_command_battery(client: RecordedClient) -> None:
    await client.new()
    await client.prompt("/battery")
    assert "The battery is at" in client.said


@shows("available command /places")
async def test_command_places(client: RecordedClient) -> None:
    await client.new()
    await client.prompt("/places")
    assert "kitchen" in client.said


@shows("available command /photo")
async def test_command_photo(client: RecordedClient) -> None:
    await client.new()
    await client.prompt("/photo")
    (content,) = client.updates("tool_call_update")[-1]["content"]
    assert content["content"]["type"] == "image"
    assert Image.open(BytesIO(base64.b64decode(content["content"]["data"]))).size == (640, 480)


@shows("available command /export", "fs/write_text_file")
async def test_fs_write_text_file(client: RecordedClient) -> None:
    client.answers["fs/write_text_file"] = lambda params: {}
    await client.new()
    await client.prompt("where are you?")
    before = client.events
    await client.prompt("/export")
    (file,) = [frame["params"] for frame in client.heard("fs/write_text_file")]
    assert file["path"].endswith(f"{client.session}.jsonl")
    lines = [json.loads(line) for line in file["content"].splitlines()]
    told = [(line["seq"], line["update"]) for line in lines]
    assert told[1 : len(before)] == [event for event in before if event[0] is not None]
    assert file["path"] in client.said


@shows("elicitation/create")
async def test_elicitation_create(client: RecordedClient) -> None:
    client.answers["elicitation/create"] = lambda params: {"action": "accept", "content": {"answer": "lab 2.3.6"}}
    await client.new()
    assert await client.prompt("go to a lab") == "end_turn"
    (form,) = client.heard("elicitation/create")
    assert "lab 2.3.6" in form["params"]["requestedSchema"]["properties"]["answer"]["enum"]
    assert "I am at lab 2.3.6." in client.said


@shows("initialize")
async def test_what_a_client_cannot_do_is_not_asked_of_it(client: RecordedClient, another: Opener) -> None:
    plain = await another({})
    await plain.new()
    assert await plain.prompt("go to a lab") == "end_turn"
    assert "Which one do you mean: lab 2.3.1" in plain.said
    assert await plain.prompt("/export") == "end_turn"
    assert "Your program takes no files from me." in plain.said
    assert [frame for sender, frame in plain.log if sender == "agent" and "method" in frame and "id" in frame] == []
    assert plain.heard("_robot/telemetry") == []
