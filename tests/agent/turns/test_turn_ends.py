"""However a turn ends, it has ended: answered, told to everyone, the robot at rest and free for the next."""

from __future__ import annotations

import asyncio
from pathlib import Path

import orjson
import pytest

from backend.agent.robot.robot_client import RobotClient
from backend.chat.link import RefusedError
from backend.identity import Role
from backend.robot_server import RobotServerClient
from tests.agent.acp.test_connection import HELLO, dial
from tests.agent.conftest import Opener, holds_the_robot
from tests.databases import Database
from tests.processes import Client, Robot, eventually


async def set_mode(client: Client, mode: str) -> None:
    await client.link.request("session/set_mode", {"sessionId": client.session, "modeId": mode})


async def test_a_mode_that_changed_while_one_waited_for_the_robot_counts(robot: Robot, connect: Opener) -> None:
    holding, waiting = await connect(answer=None), await connect()
    await waiting.new()
    first = await holds_the_robot(holding)
    second = asyncio.create_task(waiting.prompt("go to the kitchen"))
    await eventually(lambda: "waiting for the robot" in str(waiting.updates), "the wait")
    await set_mode(waiting, "observe")
    await holding.cancel()
    assert await first == "cancelled"
    async with robot.watched() as watched:
        assert await second == "end_turn"
        assert all(state.twist.linear == 0 for _, state in watched.states)
    assert "not allowed in the mode Observe" in waiting.said


async def test_a_mode_that_changed_while_people_thought_about_it_counts(robot: Robot, connect: Opener) -> None:
    client = await connect(answer=None)
    await client.new()
    async with robot.watched() as watched:
        turn = client.later(client.prompt("say hello"))
        await eventually(lambda: client.questions, "the question")
        await set_mode(client, "observe")
        await client.decide("allow_once")
        assert await turn == "end_turn"
        assert watched.spoken == []
    assert "the mode was changed meanwhile" in client.said


async def test_a_prompt_that_is_cancelled_in_the_same_breath_is_answered(robot: Robot) -> None:
    raw = await dial(robot)
    await raw.send(orjson.dumps(HELLO))
    await raw.answer()
    await raw.send(
        orjson.dumps({"jsonrpc": "2.0", "id": 2, "method": "session/new", "params": {"cwd": "/", "mcpServers": []}})
    )
    session = (await raw.answer())["result"]["sessionId"]
    blocks = [{"type": "text", "text": "go to the kitchen"}]
    prompt = {"jsonrpc": "2.0", "id": 3, "method": "session/prompt", "params": {"sessionId": session, "prompt": blocks}}
    cancel = {"jsonrpc": "2.0", "method": "session/cancel", "params": {"sessionId": session}}
    await raw.send(orjson.dumps(prompt) + b"\n" + orjson.dumps(cancel))
    while (answer := await raw.answer()).get("id") != 3:
        pass
    assert answer["result"]["stopReason"] == "cancelled"
    raw.writer.close()


async def test_one_who_may_no_longer_approve_does_not(robot: Robot, connect: Opener) -> None:
    client = await connect(answer=None)
    await client.new()
    turn = client.later(client.prompt("say hello"))
    await eventually(lambda: client.questions, "the question")
    token = robot.token("Vic", Role.VIEWER)
    await client.link.request("authenticate", {"methodId": "token", "_meta": {"robot-acp/token": token}})
    await client.decide("allow_always")
    assert await turn == "end_turn"
    assert "I did not say" in client.said


async def test_logout_shows_nothing_more_and_asks_nothing_more(connect: Opener) -> None:
    client, other = await connect(answer=None), await connect()
    session = await client.new()
    await other.load(session)
    await client.link.request("logout", {})
    before = len(client.heard)
    await other.prompt("say hello")
    assert len(client.heard) == before
    with pytest.raises(RefusedError, match="Log in first"):
        await client.link.request("session/list", {})


async def test_initialize_again_changes_nothing(robot: Robot, connect: Opener) -> None:
    client = await connect(robot.token("Vic", Role.VIEWER))
    for _ in range(3):
        hello = await client.link.request("initialize", {"protocolVersion": 1})
        assert hello["agentCapabilities"]["_meta"]["robot-acp"]["role"] == "viewer"


async def test_two_loads_at_once_do_not_mix(connect: Opener) -> None:
    live, client = await connect(), await connect()
    session = await live.new()
    await live.prompt("where are you?")
    await asyncio.gather(client.load(session), client.load(session))
    once = list(range(1, live.numbers[-1] + 1))
    assert client.numbers == once * 2
    await live.prompt("where are you?")
    await eventually(lambda: client.numbers[-1] == live.numbers[-1], "the next turn")
    assert client.numbers[len(once) * 2 :] == list(range(once[-1] + 1, live.numbers[-1] + 1))


async def test_a_fork_has_the_same_past_and_a_future_of_its_own(connect: Opener) -> None:
    client, reader = await connect(), await connect()
    session = await client.new()
    await client.prompt("turn left by 10 degrees")
    fork = (await client.link.request("session/fork", {"sessionId": session, "cwd": "/", "mcpServers": []}))[
        "sessionId"
    ]
    client.session = fork
    await client.prompt("where are you?")
    await reader.load(session)
    original = list(reader.updates)
    reader.heard.clear()
    await reader.load(fork)
    assert reader.updates[: len(original)] == original
    assert reader.numbers == list(range(1, len(reader.numbers) + 1))
    assert len(reader.updates) > len(original)


async def test_commands_run_without_the_model_under_the_same_policy(connect: Opener) -> None:
    client = await connect()
    await client.new()
    await eventually(lambda: "available_commands_update" in str(client.heard), "the commands")
    await client.prompt("/where")
    assert "I am at x" in client.said
    await set_mode(client, "observe")
    await client.prompt("/home")
    assert "not allowed in the mode Observe" in client.said
    await client.prompt("/export")
    assert "takes no files" in client.said
    assert client.of("agent_thought_chunk") == []


async def test_a_stop_is_made_although_whoever_asked_for_it_is_gone(robot: Robot) -> None:
    bearer = robot.robot_headers["Authorization"].removeprefix("Bearer ")
    link = RobotClient(RobotServerClient(f"http://127.0.0.1:{robot.robot_port}", bearer.encode()))
    asked = asyncio.create_task(link.stop("Ana"))
    await asyncio.sleep(0)
    asked.cancel()
    try:
        async with robot.watched() as watched:
            await watched.until(lambda: watched.state.stop, "the stop")
    finally:
        await link.release("Ana")


async def test_motion_asks_where_the_session_wants_it(connect: Opener) -> None:
    client = await connect(answer="reject_once")
    await client.new()
    wish = {"sessionId": client.session, "configId": "motion_asks", "type": "boolean", "value": True}
    await client.link.request("session/set_config_option", wish)
    await client.prompt("turn left by 10 degrees")
    assert len(client.questions) == 1
    assert "refused by local" in client.said
    off = {"sessionId": client.session, "configId": "thought", "type": "boolean", "value": False}
    thoughts = len(client.of("agent_thought_chunk"))
    await client.link.request("session/set_config_option", off)
    await client.prompt("where are you?")
    assert len(client.of("agent_thought_chunk")) == thoughts


async def test_a_stop_that_was_released_is_not_made_again_when_its_turn_comes(robot: Robot, connect: Opener) -> None:
    client = await connect(answer=None)
    await client.new()
    async with robot.watched() as watched:
        first = client.later(client.prompt("say hello"))
        await eventually(lambda: client.questions, "the question")
        stop = client.later(client.prompt("/stop"))
        await watched.until(lambda: watched.state.stop is not None, "the stop")
        await client.link.request("_robot/release", {})
        await watched.until(lambda: watched.state.stop is None, "the release")
        seen = len(watched.states)
        await client.decide("allow_once")
        assert (await first, await stop) == ("end_turn", "end_turn")
        ended = len(watched.states)
        await watched.until(lambda: len(watched.states) > ended + 3, "news of the robot")
        assert all(state.stop is None for _, state in watched.states[seen:])


async def test_a_log_that_cannot_be_written_is_in_no_stops_way(tmp_path: Path, database: Database) -> None:
    robot = Robot(tmp_path, {"ROBOT_ACP_AGENT__DATABASE": database.url})
    with robot.running("robot", port=robot.robot_port), robot.running("agent", port=robot.agent_port):
        client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
        await client.new()
        await client.prompt("where are you?")
        database.execute("ALTER TABLE events RENAME TO lost")
        await client.prompt("where are you?")
        with pytest.raises(RefusedError, match="log cannot be written"):
            await client.prompt("where are you?")
        async with robot.watched() as watched:
            assert await client.prompt("/stop") == "end_turn"
            await watched.until(lambda: watched.state.stop is not None, "the stop")
        await client.close()
