"""Conformance: what can be done with sessions, and what can be set in one."""

from __future__ import annotations

import pytest

from backend.agent.sessions.sessions import PAGE
from backend.identity import Role
from tests.conformance.cases import shows
from tests.conformance.recorded_client import LONG, RecordedClient, Refused
from tests.conformance.test_connection import INVALID_PARAMS, log_in
from tests.processes import Robot, eventually

pytestmark = pytest.mark.asyncio(loop_scope="module")


@shows("session/new")
async def test_session_new(client: RecordedClient) -> None:
    answer = await client.new()
    assert answer["modes"]["currentModeId"] == "supervised"
    assert [mode["id"] for mode in answer["modes"]["availableModes"]] == [
        "observe",
        "plan",
        "movement",
        "supervised",
        "autonomous",
    ]
    assert {option["id"] for option in answer["configOptions"]} == {"mode", "model", "thought", "motion_asks"}
    assert answer["models"]["currentModelId"] in [model["modelId"] for model in answer["models"]["availableModels"]]
    stdio = {"name": "x", "command": "/bin/true", "args": [], "env": []}
    http = {"type": "http", "name": "x", "url": "https://x.example.org/mcp", "headers": []}
    for server, said in ((stdio, "commands on the robot's computer"), (http, "agent.mcp_allow")):
        with pytest.raises(Refused, match=said) as refused:
            await client.request("session/new", {"cwd": "/", "mcpServers": [server]})
        assert refused.value.code == INVALID_PARAMS


@shows("session/load")
async def test_session_load(client: RecordedClient) -> None:
    await client.new()
    await client.prompt("turn left by 20 degrees")
    live = client.events
    client.forget()
    answer = await client.open_again("session/load")
    replayed = [event for event in client.events if event[0] is not None]
    assert client.numbers == list(range(1, len(replayed) + 1))
    assert replayed[0][1]["content"]["text"] == "turn left by 20 degrees"
    assert replayed[1:] == [event for event in live if event[0] is not None]
    assert answer["modes"]["currentModeId"] == "supervised"


@shows("session/resume")
async def test_session_resume(client: RecordedClient) -> None:
    await client.new()
    await client.prompt("where are you?")
    last = client.numbers[-1]
    client.forget()
    assert (await client.open_again("session/resume"))["modes"]["currentModeId"] == "supervised"
    assert client.numbers == []
    await client.open_again("session/resume", {"robot-acp/after": 2})
    assert client.numbers == list(range(3, last + 1))


@shows("session/list")
async def test_session_list(robot: Robot, client: RecordedClient) -> None:
    made = set()
    for _ in range(PAGE + 1):
        await client.new()
        await client.of_session("session/set_mode", modeId="supervised")  # a session in which nothing is, is not listed
        made.add(client.session)
    await eventually(lambda: client.updates("current_mode_update"), "what is seen is kept")
    listed: list[str] = []
    cursor: str | None = None
    pages = 0
    while pages == 0 or cursor:
        page = await client.request("session/list", {"cursor": cursor} if cursor else {})
        listed += [session["sessionId"] for session in page["sessions"]]
        cursor = page.get("nextCursor")
        pages += 1
    assert pages > 1
    assert len(listed) == len(set(listed))
    assert made <= set(listed)
    try:
        await log_in(client, robot, "Vera", Role.VISITOR)
        await client.new()
        await client.prompt("where are you?")
        page = await client.request("session/list", {})
        assert [session["sessionId"] for session in page["sessions"]] == [client.session]
        await client.of_session("session/delete")
    finally:
        await log_in(client, robot, "Ana", Role.SUPERVISOR)


@shows("session/fork")
async def test_session_fork(client: RecordedClient) -> None:
    await client.new()
    await client.prompt("where are you?")
    original, past = client.session, client.events
    answer = await client.open_again("session/fork")
    assert answer["sessionId"] != original
    client.session = answer["sessionId"]
    await client.open_again("session/load")
    _prompt, *copied, (_, forked) = [event for event in client.events if event[0] is not None]
    assert copied == [event for event in past if event[0] is not None]
    assert forked["_meta"]["robot-acp/forked"] == {"from": original}


@shows("session/close")
async def test_session_close(robot: Robot, client: RecordedClient) -> None:
    await client.new()
    async with robot.watched() as watched:
        turn = client.later(client.prompt(LONG))
        await watched.until(lambda: watched.speed, "the robot to drive")
        await client.of_session("session/close")
        assert await turn == "cancelled"
        assert await robot.stands()
    await client.open_again("session/load")


@shows("session/delete")
async def test_session_delete(client: RecordedClient) -> None:
    await client.new()
    await client.of_session("session/delete")
    with pytest.raises(Refused, match="There is no session") as refused:
        await client.open_again("session/load")
    assert refused.value.code == INVALID_PARAMS


@shows("session/set_mode", "session/update current_mode_update", "session/update config_option_update")
async def test_session_set_mode(client: RecordedClient) -> None:
    await client.new()
    await client.of_session("session/set_mode", modeId="observe")
    await client.prompt("turn left by 20 degrees")
    assert "not allowed in the mode Observe" in client.said
    assert client.updates("current_mode_update") == [
        {"sessionUpdate": "current_mode_update", "currentModeId": "observe"}
    ]
    with pytest.raises(Refused) as refused:
        await client.of_session("session/set_mode", modeId="nonsense")
    assert refused.value.code == INVALID_PARAMS


async def change(client: RecordedClient, option: str, value: str | bool) -> None:
    """Set an option; the answer and the update both tell the new value."""
    kind = {"type": "boolean"} if isinstance(value, bool) else {}
    answer = await client.of_session("session/set_config_option", configId=option, value=value, **kind)
    await eventually(lambda: client.updates("config_option_update"), "the change")
    assert {o["id"]: o["currentValue"] for o in answer["configOptions"]}[option] == value
    assert answer["configOptions"] == client.updates("config_option_update")[-1]["configOptions"]


@shows("session/set_config_option mode")
async def test_session_set_config_option_mode(robot: Robot, client: RecordedClient) -> None:
    await client.new()
    await change(client, "mode", "plan")
    async with robot.watched() as watched:
        await client.prompt("go to the kitchen")
        await watched.until(lambda: watched.previews, "the path")
        assert all(state.twist.linear == 0 for _, state in watched.states)


@shows("session/set_config_option model")
async def test_session_set_config_option_model(client: RecordedClient) -> None:
    await client.new()
    await change(client, "model", "offline/commands")
    with pytest.raises(Refused, match="There is no such model") as refused:
        await client.of_session("session/set_config_option", configId="model", value="somebody/else")
    assert refused.value.code == INVALID_PARAMS


@shows("session/set_config_option thought")
async def test_session_set_config_option_thought(client: RecordedClient) -> None:
    await client.new()
    await change(client, "thought", False)
    await client.prompt("where are you?")
    assert client.updates("agent_thought_chunk") == []


@shows("session/set_config_option motion_asks", "session/request_permission")
async def test_session_set_config_option_motion_asks(client: RecordedClient) -> None:
    await client.new()
    await change(client, "motion_asks", True)
    await client.prompt("turn left by 20 degrees")
    (question,) = client.heard("session/request_permission")
    assert question["params"]["toolCall"]["rawInput"] == {"degrees": 20}


@shows("session/set_model")
async def test_session_set_model(client: RecordedClient) -> None:
    answer = await client.new()
    await client.of_session("session/set_model", modelId=answer["models"]["availableModels"][-1]["modelId"])
    with pytest.raises(Refused) as refused:
        await client.of_session("session/set_model", modelId="somebody/else")
    assert refused.value.code == INVALID_PARAMS
    loaded = await client.open_again("session/load")
    assert loaded["models"]["currentModelId"] == answer["models"]["availableModels"][-1]["modelId"]
