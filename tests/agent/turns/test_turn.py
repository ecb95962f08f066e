"""The agent over TCP, with the real robot server under it: the paper's turn, and what goes wrong around it."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest

from backend.chat.link import LinkError, RefusedError
from backend.identity import Role
from tests.agent.conftest import Opener, client_of_an_impatient_agent
from tests.processes import Client, Robot, eventually

NOON = "Go to lab 2.3.7 and tell them that the meeting is at noon"


def tool_of(update: dict[str, Any]) -> str:
    return str(update["_meta"]["robot-acp/tool"])


def ends(updates: list[dict[str, Any]]) -> dict[str, str]:
    """How each tool call ended, by id."""
    closing = [
        u for u in updates if u["sessionUpdate"] == "tool_call_update" and u.get("status") in ("completed", "failed")
    ]
    return {u["toolCallId"]: u["status"] for u in closing}


async def test_the_papers_first_prompt(robot: Robot, connect: Opener) -> None:
    client = await connect()
    await client.new()
    async with robot.watched() as watched:
        assert await client.prompt(NOON) == "end_turn"
        place = next(n for n in client.of("tool_call_update") if "nodes" in (n.get("rawOutput") or {}))
        lab = next(n["position"] for n in place["rawOutput"]["nodes"] if n["name"] == "lab 2.3.7")
        assert watched.distance_to(lab["x"], lab["y"]) < 0.3
        assert watched.spoken == ["The meeting is at noon."]
    kinds = [u["sessionUpdate"] for u in client.updates]
    assert kinds[0] == "agent_thought_chunk"
    calls = client.of("tool_call")
    assert [tool_of(c) for c in calls] == ["get_topological_map", "navigate_to_place", "speak"]
    assert [c["title"] for c in calls] == ["Read the map", "Drive to lab 2.3.7", "Say aloud: “The meeting is at noon.”"]
    assert [c["kind"] for c in calls] == ["read", "execute", "execute"]
    driving = [u for u in client.of("tool_call_update") if u["toolCallId"] == calls[1]["toolCallId"]]
    assert any("m to go, about" in json.dumps(u) for u in driving)
    (question,) = client.questions
    assert question["params"]["toolCall"]["toolCallId"] == calls[2]["toolCallId"]
    assert set(ends(client.updates).values()) == {"completed"}
    spoken = next(
        u for u in client.of("tool_call_update") if u["toolCallId"] == calls[2]["toolCallId"] and "rawOutput" in u
    )
    assert spoken["content"][0]["content"]["type"] == "audio"
    assert client.of("plan")[-1]["entries"][-1]["status"] == "completed"
    assert "I said: “The meeting is at noon.”" in client.said
    assert client.updates[-1]["_meta"]["robot-acp/turn"]["stopReason"] == "end_turn"


async def test_a_rejected_permission_is_a_refusal(robot: Robot, connect: Opener) -> None:
    client = await connect(answer="reject_once")
    await client.new()
    async with robot.watched() as watched:
        assert await client.prompt("say hello") == "end_turn"
        assert watched.spoken == []
    assert "I did not say “Hello.”: refused by local." in client.said
    failed = client.of("tool_call_update")[-1]
    assert failed["status"] == "failed"
    assert failed["_meta"]["robot-acp/decision"] == {"by": "local", "option": "reject_once", "reason": "selected"}


async def test_no_answer_in_time_is_a_refusal(robot: Robot) -> None:
    async with client_of_an_impatient_agent(robot, answer=None) as client:
        await client.prompt("say hello")
        assert "nobody answered in time" in client.said
        withdrawn = [m for m in client.heard if m["method"] == "$/cancel_request"]
        assert [m["params"]["requestId"] for m in withdrawn] == [client.questions[0]["id"]]


async def test_nobody_who_may_approve_is_a_refusal(robot: Robot) -> None:
    alone = robot.with_another_agent()  # nobody has been here a moment ago, and is expected back
    with alone.running("agent", port=alone.agent_port):
        visitor = await Client.open(f"tcp://127.0.0.1:{alone.agent_port}")
        token = {"robot-acp/token": robot.token("Vera", Role.VISITOR)}
        await visitor.link.request("authenticate", {"methodId": "token", "_meta": token})
        await visitor.new()
        await visitor.prompt("say hello")
        assert "nobody is there who may allow it" in visitor.said
        assert visitor.questions == []
        await visitor.close()


async def test_a_supervisor_who_comes_to_a_visitors_session_is_asked_and_the_visitor_sees_the_wait(
    robot: Robot, connect: Opener
) -> None:
    supervisor = await connect(answer=None, capabilities={"_meta": {"robot-acp/telemetry": {"rate": 10}}})
    await supervisor.new()
    visitor = await connect(robot.token("Vera", Role.VISITOR))
    await visitor.new()

    def waiting() -> list[dict[str, Any]]:
        metas = [update.get("_meta") or {} for update in visitor.of("tool_call_update")]
        return [meta["robot-acp/waiting"] for meta in metas if "robot-acp/waiting" in meta]

    def holder() -> str | None:
        turns = [m["params"]["turn"] for m in supervisor.heard if m["method"] == "_robot/telemetry"]
        return turns[-1]["sessionId"] if turns and turns[-1] else None

    async with robot.watched() as watched:
        turn = visitor.later(visitor.prompt("say hello"))
        await eventually(waiting, "the wait")
        await eventually(lambda: holder() == visitor.session, "the telemetry to tell whose turn it is")
        await supervisor.load(visitor.session)
        await eventually(lambda: supervisor.questions, "the question")
        await supervisor.load(visitor.session)
        await eventually(lambda: len(supervisor.questions) == 2, "the question again")
        await supervisor.decide("allow_once")
        assert await turn == "end_turn"
        assert watched.spoken == ["Hello."]
    assert waiting() == [{"for": "permission", "timeout_s": 60.0}]
    assert visitor.questions == []


async def test_always_counts_for_the_rest_of_the_session_and_for_that_tool(connect: Opener) -> None:
    client = await connect(answer="allow_always")
    await client.new()
    await client.prompt("say hello and then say goodbye")
    await client.prompt("say it again")
    assert len(client.questions) == 1
    assert list(ends(client.updates).values()) == ["completed"] * 3
    await client.new()
    await client.prompt("say hello")
    assert len(client.questions) == 2


async def test_cancel_withdraws_a_pending_permission(connect: Opener) -> None:
    client = await connect(answer=None)
    await client.new()
    turn = asyncio.create_task(client.prompt("say hello"))
    await eventually(lambda: client.questions, "the question")
    await client.cancel()
    assert await turn == "cancelled"
    assert any(m["method"] == "$/cancel_request" for m in client.heard)
    assert set(ends(client.updates).values()) == {"failed"}


async def test_all_who_are_attached_see_the_same_events_in_the_same_order(connect: Opener) -> None:
    asking, watching = await connect(), await connect(answer=None)
    session = await asking.new()
    await watching.load(session)
    await asking.prompt("say hello")
    await eventually(lambda: watching.numbers and watching.numbers[-1] == asking.numbers[-1], "the last event")
    assert watching.numbers == list(range(1, len(watching.numbers) + 1))
    assert watching.updates[0]["content"]["text"] == "say hello"
    assert watching.updates[1:] == asking.updates


async def test_load_replays_exactly_what_was_seen_live(connect: Opener) -> None:
    live, later = await connect(), await connect()
    session = await live.new()
    await live.prompt("turn left by 30 degrees")
    answer = await later.load(session)
    assert later.numbers == list(range(1, len(later.numbers) + 1))
    assert later.updates[1:] == live.updates
    assert answer["modes"]["currentModeId"] == "supervised"
    listed = (await later.link.request("session/list", {}))["sessions"]
    assert listed[0]["sessionId"] == session
    assert listed[0]["title"] == "turn left by 30 degrees"


async def test_resume_gives_what_follows_an_event(connect: Opener) -> None:
    live, later = await connect(), await connect()
    session = await live.new()
    await live.prompt("where are you?")
    resume = {"sessionId": session, "cwd": "/", "_meta": {"robot-acp/after": 3}}
    await later.link.request("session/resume", resume)
    assert later.numbers == list(range(4, live.numbers[-1] + 1))


async def test_a_turn_goes_on_when_the_one_who_asked_is_gone(robot: Robot, connect: Opener) -> None:
    asking, watching = await connect(answer=None), await connect(answer=None)
    session = await asking.new()
    await watching.load(session)
    turn = asyncio.create_task(asking.prompt("say hello"))
    await eventually(lambda: watching.questions, "the question")
    await asking.close()
    with pytest.raises(LinkError):
        await turn
    await watching.decide("allow_once")
    await eventually(lambda: "I said: “Hello.”" in watching.said, "the end of the turn")


@pytest.mark.parametrize(
    ("asked", "answered"),
    [
        ("go to lab 9", "No place called lab 9. Known places: lab 2.3.9"),
        ("go to the lab", "Which one do you mean: lab 2.3.1"),
        ("go to (0.05, 0.05)", "inside a wall"),
        ("go to (500, 0)", "I did not get there."),
        ("make me a sandwich", "I did not understand that. I am no language model"),
        ("what can you do?", "I am no language model, only a small set of commands. I can:"),
        ("how is the battery?", "The battery is at"),
        ("which places are there?", "reception"),
    ],
)
async def test_answers_in_words_that_a_person_can_act_on(connect: Opener, asked: str, answered: str) -> None:
    client = await connect()
    await client.new()
    assert await client.prompt(asked) == "end_turn"
    assert answered in client.said


async def test_a_long_speech_comes_back_whole(connect: Opener) -> None:
    client = await connect()
    await client.new()
    await client.prompt("say " + "this is a long sentence about lunch " * 11)
    assert list(ends(client.updates).values()) == ["completed"]


async def test_observe_moves_nothing_and_says_why(robot: Robot, connect: Opener) -> None:
    client = await connect()
    await client.new()
    await client.link.request("session/set_mode", {"sessionId": client.session, "modeId": "observe"})
    async with robot.watched() as watched:
        await client.prompt("go to the kitchen")
        assert all(state.twist.linear == 0 for _, state in watched.states)
    assert "not allowed in the mode Observe" in client.said
    assert client.of("current_mode_update")[0]["currentModeId"] == "observe"


async def test_plan_shows_the_path_and_moves_nothing(robot: Robot, connect: Opener) -> None:
    client = await connect()
    await client.new()
    option = {"sessionId": client.session, "configId": "mode", "value": "plan"}
    await client.link.request("session/set_config_option", option)
    async with robot.watched() as watched:
        await client.prompt("go to lab 2.3.2")
        await watched.until(lambda: watched.previews, "the path")
        assert all(state.twist.linear == 0 for _, state in watched.states)
    assert "I did not move." in client.said


async def test_only_the_models_of_the_settings_can_be_chosen(connect: Opener) -> None:
    client = await connect()
    await client.new()
    option = {"sessionId": client.session, "configId": "model", "value": "openai/gpt-4o-mini"}
    with pytest.raises(RefusedError, match=r"There is no such model\. Models: offline/commands"):
        await client.link.request("session/set_config_option", option)


async def test_stop_and_release_over_acp(robot: Robot, connect: Opener) -> None:
    local, viewer = await connect(), await connect(robot.token("Vic", Role.VIEWER))
    try:
        assert (await viewer.link.request("_robot/stop", {}))["stopped"]["by"] == "Vic"
        await local.new()
        await local.prompt("go to the kitchen")
        assert "Stopped by Vic" in local.said
        with pytest.raises(RefusedError, match="The role viewer may not release"):
            await viewer.link.request("_robot/release", {})
    finally:
        assert (await local.link.request("_robot/release", {}))["stopped"] is None


async def test_telemetry_is_for_those_who_ask_for_it(connect: Opener) -> None:
    wants = {"_meta": {"robot-acp/telemetry": {"rate": 10}}}
    asking, silent = await connect(capabilities=wants), await connect()

    def online() -> list[dict[str, Any]]:
        return [told["params"] for told in asking.heard if told["params"]["online"]]

    await eventually(lambda: len(online()) >= 3, "telemetry")
    assert {told["method"] for told in asking.heard} == {"_robot/telemetry"}
    assert online()[-1]["battery"]["level"] > 0.5
    assert silent.heard == []


@pytest.mark.parametrize(
    ("role", "method", "params", "error"),
    [
        (Role.VIEWER, "session/new", {"cwd": "/", "mcpServers": []}, "The role viewer may not prompt"),
        (Role.VISITOR, "session/set_mode", {"modeId": "autonomous"}, "The role visitor may not configure"),
    ],
)
async def test_roles_limit_what_one_may_do(
    robot: Robot, connect: Opener, role: Role, method: str, params: dict[str, Any], error: str
) -> None:
    client = await connect(robot.token("Sam", role))
    if "modeId" in params:
        await client.new()
        params = params | {"sessionId": client.session}
    with pytest.raises(RefusedError, match=error):
        await client.link.request(method, params)


async def test_a_visitor_sees_own_sessions_only(robot: Robot, connect: Opener) -> None:
    local, visitor = await connect(), await connect(robot.token("Vera", Role.VISITOR))
    session = await local.new()
    await local.prompt("where are you?")
    with pytest.raises(RefusedError, match="There is no session"):
        await visitor.load(session)
    assert session not in {s["sessionId"] for s in (await visitor.link.request("session/list", {}))["sessions"]}


async def test_a_forged_or_expired_token_is_refused(robot: Robot, connect: Opener) -> None:
    with pytest.raises(RefusedError, match="not valid for this robot"):
        await connect("eyJhbGciOiJub25lIn0.e30.")
    with pytest.raises(RefusedError, match="expired"):
        await connect(robot.token("Sam", Role.OPERATOR, -1))
