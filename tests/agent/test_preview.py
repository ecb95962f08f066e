"""Before people are asked to let the robot drive they see where: its length, its time, and the way on the map."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Any

import pytest

from backend.agent import preview
from backend.agent.phases import Phases
from backend.agent.robot_link import RobotLink
from backend.agent.tool_server import ProgressCallback, ServerUnavailable, Tool, ToolResult, ToolServer
from tests.agent.conftest import Opener
from tests.processes import Client, Robot, eventually

FLAG = {"type": "object", "properties": {"place": {"type": "string"}, "plan_only": {"type": "boolean"}}}
DRIVE = Tool("navigate_to_place", "Drive", FLAG, "Drive", None, False)


async def asking(client: Client) -> Client:
    """The client in a session in which motion asks first."""
    await client.new()
    wish = {"sessionId": client.session, "configId": "motion_asks", "type": "boolean", "value": True}
    await client.link.request("session/set_config_option", wish)
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
        await client.prompt("go to the reception")
        assert any(state.motion for _, state in watched.states)
        await watched.until(lambda: watched.path and not watched.path.points, "the way to go")
    assert client.questions[0]["params"]["_meta"]["robot-acp/preview"]["path_length"] > 0


async def test_nobody_is_asked_for_what_the_robot_would_refuse(client: Client) -> None:
    await client.prompt("go to (0.05, 0.05)")
    assert client.questions == []
    assert "inside a wall" in client.said
    (end,) = [u for u in client.of("tool_call_update") if u.get("status") == "failed"]
    assert end["rawOutput"]["error"]["code"] == "occupied"


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
    other = robot.with_another_agent({"ROBOT_ACP_AGENT__PREVIEW": ""})
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


class Answering(ToolServer):
    """A robot server that gives one answer to every call, an exception among them, or never any."""

    def __init__(self, answer: ToolResult | Exception | None) -> None:
        super().__init__("http://127.0.0.1:1/mcp", absent="")
        self.answer = answer
        self.calls: list[dict[str, Any]] = []

    async def call(
        self, name: str, arguments: dict[str, Any], on_progress: ProgressCallback | None = None
    ) -> ToolResult:
        self.calls.append(arguments)
        if self.answer is None:
            await asyncio.Event().wait()
        if isinstance(self.answer, ToolResult):
            return self.answer
        raise self.answer or AssertionError


class Forgetful(RobotLink):
    """Counts how often a preview was taken back."""

    def __init__(self) -> None:
        super().__init__(None, None)
        self.forgotten = 0

    async def forget_preview(self) -> None:
        self.forgotten += 1


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
async def test_a_preview_that_fails_leaves_the_question(
    answer: ToolResult | Exception | None, meta: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(preview, "TIMEOUT_S", 0.05)
    tools, link = Answering(answer), Forgetful()
    async with preview.shown(tools, link, Phases(), "plan_only", DRIVE, {"place": "dock"}) as view:
        assert view.meta == meta
        assert link.forgotten == 0
    assert tools.calls == [{"place": "dock", "plan_only": True}]
    assert link.forgotten == 1


async def test_what_goes_on_keeps_its_way() -> None:
    link = Forgetful()
    async with preview.shown(Answering(ToolResult(False, [], {})), link, Phases(), "plan_only", DRIVE, {}) as view:
        view.stays = True
    assert link.forgotten == 0


@pytest.mark.parametrize(
    ("argument", "tool"),
    [
        ("", DRIVE),
        ("dry_run", DRIVE),
        ("plan_only", replace(DRIVE, server="lab")),
        ("plan_only", replace(DRIVE, parameters={"properties": {"plan_only": {"type": "string"}}})),
        ("plan_only", replace(DRIVE, parameters={})),
    ],
    ids=["switched off", "another flag", "a client's server", "no flag", "no arguments"],
)
async def test_only_a_flag_of_the_robots_own_tools_is_set(argument: str, tool: Tool) -> None:
    tools, link = Answering(ToolResult(False, [], {})), Forgetful()
    async with preview.shown(tools, link, Phases(), argument, tool, {}) as view:
        assert view.meta is None
    assert tools.calls == []
    assert link.forgotten == 0
