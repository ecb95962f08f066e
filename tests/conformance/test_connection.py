"""Conformance: saying hello, logging in and out, cancelling requests, what is unknown, and what is ours."""

from __future__ import annotations

from typing import Any

import pytest

from backend.identity import Role
from tests.conformance.cases import NO_TERMINAL, UNKNOWN, shows
from tests.conformance.conftest import Opener
from tests.conformance.recorded_client import EVERYTHING, LONG, RecordedClient, Refused
from tests.processes import Robot, eventually

pytestmark = pytest.mark.asyncio(loop_scope="module")

AUTH_REQUIRED, NOT_ALLOWED, METHOD_NOT_FOUND, INVALID_PARAMS = -32000, -32001, -32601, -32602


async def log_in(client: RecordedClient, robot: Robot, name: str, role: Role) -> None:
    meta = {"robot-acp/token": robot.token(name, role)}
    assert await client.request("authenticate", {"methodId": "token", "_meta": meta}) == {}


@shows("initialize")
async def test_initialize(client: RecordedClient, another: Opener) -> None:
    fresh = await another({})
    hello = next(frame["result"] for sender, frame in fresh.log if sender == "agent")
    assert hello["protocolVersion"] == 1
    assert hello["agentInfo"]["name"] == "robot-acp"
    assert [method["id"] for method in hello["authMethods"]] == ["token"]
    capabilities = hello["agentCapabilities"]
    assert capabilities["loadSession"] is True
    assert capabilities["promptCapabilities"] == {"image": True, "audio": False, "embeddedContext": True}
    assert set(capabilities["sessionCapabilities"]) >= {"list", "resume", "fork", "close", "delete"}
    ours = capabilities["_meta"]["robot-acp"]
    assert set(ours["extensions"]) >= {"_robot/telemetry", "_robot/stop", "_robot/release", "_robot/take_over"}
    assert (ours["robot"], ours["role"]) == ("Sancho", "supervisor")


@shows("initialize")
async def test_initialize_with_a_version_of_the_future(client: RecordedClient) -> None:
    params = {"protocolVersion": 7, "clientCapabilities": EVERYTHING}
    assert (await client.request("initialize", params))["protocolVersion"] == 1


@shows("authenticate", "logout")
async def test_authenticate(robot: Robot, client: RecordedClient) -> None:
    try:
        await log_in(client, robot, "Vic", Role.VIEWER)
        with pytest.raises(Refused, match="The role viewer may not prompt") as refused:
            await client.new()
        assert refused.value.code == NOT_ALLOWED
        for wrong in ("", "nonsense", robot.token("Ana", Role.SUPERVISOR, -1)):
            with pytest.raises(Refused) as refused:
                await client.request("authenticate", {"methodId": "token", "_meta": {"robot-acp/token": wrong}})
            assert refused.value.code == AUTH_REQUIRED
        await client.request("logout", {})
    finally:
        await log_in(client, robot, "Ana", Role.SUPERVISOR)


@shows("logout")
async def test_logout(robot: Robot, client: RecordedClient) -> None:
    await client.new()
    try:
        assert await client.request("logout", {}) == {}
        for method, params in (("session/list", {}), ("session/new", {"cwd": "/", "mcpServers": []})):
            with pytest.raises(Refused) as refused:
                await client.request(method, params)
            assert refused.value.code == AUTH_REQUIRED
    finally:
        await log_in(client, robot, "Ana", Role.SUPERVISOR)


@shows("$/cancel_request to the agent")
async def test_cancel_request_of_the_client(robot: Robot, client: RecordedClient) -> None:
    await client.new()
    async with robot.watched() as watched:
        turn = client.later(client.prompt(LONG))
        await watched.until(lambda: watched.speed, "the robot to drive")
        prompt = next(f for sender, f in client.log if sender == "client" and f.get("method") == "session/prompt")
        await client.notify("$/cancel_request", {"requestId": prompt["id"]})
        assert await turn == "cancelled"


@shows("$/cancel_request to the client")
async def test_cancel_request_of_the_agent(client: RecordedClient) -> None:
    client.answers["session/request_permission"] = lambda params: None
    await client.new()
    turn = client.later(client.prompt("say hello"))
    (question,) = await client.hear("session/request_permission")
    await client.notify("session/cancel", {"sessionId": client.session})
    (withdrawn,) = await client.hear("$/cancel_request")
    assert withdrawn["params"]["requestId"] == question["id"]
    await client.respond(question["id"], {"outcome": {"outcome": "cancelled"}})
    assert await turn == "cancelled"


@shows(UNKNOWN)
async def test_an_unknown_method(client: RecordedClient) -> None:
    await client.notify("_nonsense/happened", {"anything": [1, 2, 3]})
    await client.notify("_robot/nonsense", {})
    for method in ("_robot/nonsense", "_nonsense"):
        with pytest.raises(Refused) as refused:
            await client.request(method, {})
        assert refused.value.code == METHOD_NOT_FOUND
    assert await client.request("session/list", {})


@shows(NO_TERMINAL)
async def test_terminals_never(client: RecordedClient) -> None:
    await client.new()
    assert await client.prompt("open a terminal and run ls") == "end_turn"
    assert await client.prompt("where are you?") == "end_turn"


@shows("_robot/telemetry")
async def test_robot_telemetry(client: RecordedClient) -> None:
    def online() -> list[dict[str, Any]]:
        return [frame["params"] for frame in client.heard("_robot/telemetry") if frame["params"]["online"]]

    await eventually(lambda: len(online()) >= 3, "the robot's telemetry")
    told = online()[-1]
    assert (told["robot"], told["turn"]) == ("Sancho", None)
    assert set(told["pose"]) == {"x", "y", "yaw"}


@shows("_robot/people")
async def test_robot_people(client: RecordedClient) -> None:
    await client.new()

    def told() -> bool:
        lists = [frame["params"]["people"] for frame in client.heard("_robot/people")]
        return any(client.session in person["sessions"] for people in lists for person in people)

    await eventually(told, "the one who is here, with the session")


@shows("_robot/stop", "_robot/release")
async def test_robot_stop_and_release(robot: Robot, client: RecordedClient) -> None:
    await client.new()
    async with robot.watched() as watched:
        try:
            assert "by" in (await client.request("_robot/stop", {}))["stopped"]
            await watched.until(lambda: watched.state.stop, "the stop")
            await client.prompt("turn left by 20 degrees")
            assert "Stopped by" in client.said
            await log_in(client, robot, "Vic", Role.VIEWER)
            with pytest.raises(Refused, match="The role viewer may not release"):
                await client.request("_robot/release", {})
        finally:
            await log_in(client, robot, "Ana", Role.SUPERVISOR)
            assert await client.request("_robot/release", {}) == {"stopped": None}
        await watched.until(lambda: not watched.state.stop, "the release")


@shows("_robot/take_over")
async def test_robot_take_over(robot: Robot, client: RecordedClient) -> None:
    await client.new()
    first = client.session
    async with robot.watched() as watched:
        driving = client.later(client.prompt(LONG))
        await watched.until(lambda: watched.speed, "the robot to drive")
        await client.new()
        waiting = client.later(client.prompt("turn right by 10 degrees"))
        await eventually(lambda: "waiting for the robot" in str(client.updates("tool_call_update")), "the wait")
        answer = await client.request("_robot/take_over", {"sessionId": client.session})
        assert isinstance(answer["from"], str)
        assert await driving == "cancelled"
        assert await waiting == "end_turn"
    client.session = first
    assert "took the robot over" in client.said


@shows("_robot/abilities")
async def test_robot_abilities(robot: Robot, client: RecordedClient) -> None:
    told = await client.request("_robot/abilities", {})
    assert {"name": "kitchen", "type": "space"} in told["places"]
    assert {"name": "take_photo", "title": "Take a photo", "readOnly": True} in told["tools"]
    assert not next(tool["readOnly"] for tool in told["tools"] if tool["name"] == "speak")
    try:
        await log_in(client, robot, "Kiosk", Role.VISITOR)
        assert await client.request("_robot/abilities", {}) == told
        await client.request("logout", {})
        with pytest.raises(Refused) as refused:
            await client.request("_robot/abilities", {})
        assert refused.value.code == AUTH_REQUIRED
    finally:
        await log_in(client, robot, "Ana", Role.SUPERVISOR)


@shows("_robot/leave")
async def test_robot_leave(client: RecordedClient) -> None:
    await client.new()
    assert await client.of_session("_robot/leave") == {}
    assert await client.of_session("_robot/leave") == {}
    assert await client.request("_robot/leave", {"sessionId": ["nonsense"]}) == {}
    await client.of_session("session/set_mode", modeId="observe")
    assert client.updates("current_mode_update") == []
    await client.open_again("session/load")
    await eventually(lambda: client.updates("current_mode_update"), "the change")
    assert [update["currentModeId"] for update in client.updates("current_mode_update")] == ["observe"]


@shows("_robot/events")
async def test_robot_events(client: RecordedClient) -> None:
    await client.new()
    await client.of_session("session/set_mode", modeId="observe")
    await client.of_session("session/set_mode", modeId="plan")
    told = await client.of_session("_robot/events", after=1, limit=2)
    assert [event["seq"] for event in told["events"]] == [2, 3]
    assert told["last"] >= 3
    with pytest.raises(Refused):
        await client.of_session("_robot/events", after="the first")
