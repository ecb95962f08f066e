"""Before people are asked to let the robot drive they see where: its length, its time, and the way on the map."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from backend.agent.control import preview
from backend.agent.robot.mcp_client import McpClient, ProgressCallback, ServerUnavailable, Tool, ToolResult
from tests.agent.conftest import Opener, client_of_an_impatient_agent
from tests.processes import Client, Robot, eventually

DRIVE = Tool("navigate_to_place", "Drive", {}, "Drive", None, False, preview="plan_only")
ACTING = Path(__file__).parents[1] / "acting_robot.py"


async def wish_for_questions(client: Client) -> None:
    """Motion is to ask first in the client's session."""
    wish = {"sessionId": client.session, "configId": "motion_asks", "type": "boolean", "value": True}
    await client.link.request("session/set_config_option", wish)


async def asking(client: Client) -> Client:
    """The client in a session in which motion asks first."""
    await client.new()
    await wish_for_questions(client)
    return client


@pytest.fixture
async def client(connect: Opener) -> Client:
    return await asking(await connect(answer=None))


async def test_the_question_tells_how_far_it_is_and_the_robot_draws_the_way(robot: Robot, client: Client) -> None:
    async with robot.watched() as watched:
        turn = client.later(client.prompt("go to the kitchen"))
        await eventually(lambda: client.questions, "the question")
        told = client.questions[0]["params"]["_meta"]["robot-acp/preview"]
        assert told["path_length"] > 5
        assert told["seconds"] > 5
        await watched.until(lambda: watched.preview, "the way")
        assert watched.preview[-1] == pytest.approx((2.9, 9.7), abs=0.01)
        await client.decide("reject_once")
        assert await turn == "end_turn"
        await watched.until(lambda: not watched.preview, "the way to go")
        assert all(state.motion is None for _, state in watched.states)
    # The robot was asked twice, people see one call, as they wanted it.
    (call,) = [c for c in client.of("tool_call") if c["_meta"]["robot-acp/tool"] == "navigate_to_place"]
    assert "plan_only" not in call["rawInput"]
    assert "plan_only" not in client.questions[0]["params"]["toolCall"]["rawInput"]


async def test_what_people_allow_is_driven(robot: Robot, client: Client) -> None:
    client.answer = "allow_once"
    async with robot.watched() as watched:
        start = watched.state.pose
        await client.prompt("go to the reception")
        there = (await robot.state()).pose
        assert (there.x, there.y) != (start.x, start.y)
        await watched.until(lambda: watched.path and not watched.path.points, "the way to go")
    assert client.questions[0]["params"]["_meta"]["robot-acp/preview"]["path_length"] > 0


async def test_nobody_is_asked_for_what_the_robot_would_refuse(client: Client) -> None:
    await client.prompt("go to (0.05, 0.05)")
    assert client.questions == []
    assert "inside a wall" in client.said
    (end,) = [u for u in client.of("tool_call_update") if u.get("status") == "failed"]
    assert end["rawOutput"]["error"]["code"] == "occupied"


@pytest.mark.parametrize("words", ["go to the kitchen", "turn left by 20 degrees", "say hello"])
async def test_nobody_is_asked_while_the_stop_is_set(robot: Robot, connect: Opener, client: Client, words: str) -> None:
    teller = await connect(capabilities={"_meta": {"robot-acp/telemetry": {"rate": 10}}})

    def stopped() -> bool:
        """As the agent knows it."""
        return teller.heard[-1]["params"].get("stop") is not None

    async with robot.watched() as watched:
        await client.link.request("_robot/stop", {})
        try:
            await eventually(lambda: teller.heard and stopped(), "the agent to know of the stop")
            await client.prompt(words)
        finally:
            await client.link.request("_robot/release", {})
        assert watched.previews == 0
    assert client.questions == []
    (end,) = [u for u in client.of("tool_call_update") if u.get("status") == "failed"]
    assert end["rawOutput"]["error"]["code"] == "stopped"


async def test_a_release_counts_from_its_answer_on(robot: Robot, client: Client) -> None:
    for _ in range(5):
        await client.link.request("_robot/stop", {})
        async with robot.watched() as watched:
            await watched.until(lambda: watched.state.stop, "the stop")
        await client.link.request("_robot/release", {})
        asked = len(client.questions)
        turn = client.later(client.prompt("say hello"))
        await eventually(lambda known=asked: len(client.questions) > known, "the question")
        await client.decide("reject_once")
        assert await turn == "end_turn"


async def test_a_path_that_is_only_planned_is_not_drawn_over_that_of_a_question(
    robot: Robot, client: Client, connect: Opener
) -> None:
    other = await connect(answer=None)
    await other.new()
    await other.link.request("session/set_mode", {"sessionId": other.session, "modeId": "plan"})
    async with robot.watched() as watched:
        turn = client.later(client.prompt("go to the kitchen"))
        await watched.until(lambda: client.questions and watched.preview, "the question and the way")
        await other.prompt("go to lab 2.3.7")
        assert "I did not move." in other.said
        await client.decide("reject_once")
        await turn
        await watched.until(lambda: not watched.preview, "the way to go")
        assert watched.previews == 1


async def test_the_way_goes_with_the_question_that_nobody_answered(robot: Robot) -> None:
    async with robot.watched() as watched, client_of_an_impatient_agent(robot, answer=None) as client:
        await wish_for_questions(client)
        await client.prompt("go to the kitchen")
        assert "nobody answered in time" in client.said
        assert watched.previews == 1
        await watched.until(lambda: not watched.preview, "the way to go")


async def test_the_way_goes_with_the_turn_that_was_cancelled(robot: Robot, client: Client) -> None:
    async with robot.watched() as watched:
        turn = client.later(client.prompt("go to the kitchen"))
        await watched.until(lambda: client.questions and watched.preview, "the question and the way")
        await client.cancel()
        assert await turn == "cancelled"
        await watched.until(lambda: not watched.preview, "the way to go")


async def test_what_was_allowed_for_the_session_needs_no_preview(robot: Robot, client: Client) -> None:
    client.answer = "allow_always"
    await client.prompt("go to the kitchen")
    async with robot.watched() as watched:
        await client.prompt("go to the dock")
        assert watched.previews == 0
    assert len(client.questions) == 1


async def test_without_the_setting_people_are_asked_as_before(robot: Robot) -> None:
    other = robot.with_another_agent({"ROBOT_ACP_AGENT__PREVIEW": "false"})
    with other.running("agent", port=other.agent_port):
        client = await asking(await Client.open(f"tcp://127.0.0.1:{other.agent_port}", answer="reject_once"))
        await client.prompt("go to (0.05, 0.05)")
        assert "robot-acp/preview" not in client.questions[0]["params"]["_meta"]
        await client.close()


async def test_a_question_says_what_an_always_would_count_for(connect: Opener) -> None:
    client = await connect(answer="reject_once")
    await client.new()
    await client.prompt("say hello")
    meta = client.questions[0]["params"]["_meta"]
    assert meta["robot-acp/subject"] == "Say something aloud"
    assert "robot-acp/preview" not in meta


class Answering(McpClient):
    """A robot server that gives one answer to every call, an exception among them, or never any."""

    def __init__(self, answer: ToolResult | Exception | None) -> None:
        super().__init__("http://127.0.0.1:1/mcp", absent="")
        self.answer = answer
        self.calls: list[tuple[dict[str, Any], object]] = []

    async def call(
        self,
        name: str,
        arguments: dict[str, Any],
        on_progress: ProgressCallback | None = None,
        meta: Mapping[str, Any] | None = None,
    ) -> ToolResult:
        self.calls.append((arguments, meta))
        if self.answer is None:
            await asyncio.Event().wait()
        if isinstance(self.answer, ToolResult):
            return self.answer
        raise self.answer or AssertionError


@pytest.mark.parametrize(
    ("answer", "meta"),
    [
        (ToolResult(False, [], {"path_length": 3, "expected_s": 5.5}), {"path_length": 3.0, "seconds": 5.5}),
        (ToolResult(False, [], {"path_length": True}), {"path_length": None, "seconds": None}),
        (ToolResult(False, [], None), {"path_length": None, "seconds": None}),
        (ToolResult(True, [], None), None),
        (ToolResult(True, [], {"error": "broken"}), None),
        (ServerUnavailable("gone"), None),
        (None, None),
    ],
    ids=["told", "nonsense", "nothing told", "failed", "failed without a code", "gone", "too slow"],
)
async def test_a_preview_that_fails_leaves_the_question(answer: ToolResult | Exception | None, meta: object) -> None:
    tools = Answering(answer)
    assert await preview.compute(tools, DRIVE, {"place": "dock"}, "t.1", timeout_s=0.05) == meta
    asked = {"robot-acp/preview": {"id": "t.1", "rehearsal": True}}
    assert tools.calls == [({"place": "dock", "plan_only": True}, asked)]


async def test_only_a_tool_whose_server_says_so_is_believed_to_move_nothing(tmp_path: Path) -> None:
    other = Robot(tmp_path, {"ROBOT_ACP_AGENT__ROBOT_URL": f"stdio:{sys.executable} {ACTING}"})
    with other.running("agent", port=other.agent_port):
        client = await asking(await Client.open(f"tcp://127.0.0.1:{other.agent_port}", answer="reject_once"))
        await client.prompt("turn left by 20 degrees")
        assert len(client.questions) == 1
        assert "robot-acp/preview" not in client.questions[0]["params"]["_meta"]
        mode = {"sessionId": client.session, "modeId": "plan"}
        await client.link.request("session/set_mode", mode)
        await client.prompt("turn left by 20 degrees")
        assert "not allowed in the mode Plan" in client.said
        await client.prompt("where are you")
        assert "x 0.0 m, y 0.0 m" in client.said  # it has never moved
        await client.close()


@pytest.mark.parametrize(
    "tool",
    [replace(DRIVE, preview=None), replace(DRIVE, server="lab")],
    ids=["says nothing", "a client's server"],
)
def test_what_cannot_preview(tool: Tool) -> None:
    assert DRIVE.can_preview
    assert not tool.can_preview
    assert not tool.traits.can_preview
