"""Each process can die and come back; what people have seen stays, and they are told what to do."""

from __future__ import annotations

import asyncio
import signal
import sqlite3
import subprocess
from pathlib import Path

from backend.chat.link import LinkError
from tests.processes import PATIENCE_S, Client, Robot, end, eventually


async def test_a_robot_server_that_is_not_there_is_told_and_comes_back_without_a_restart(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    with robot.running("agent", port=robot.agent_port):
        client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
        await client.new()
        assert await client.prompt("where are you?") == "end_turn"
        assert "does not answer. Start it with `robot-acp robot`" in client.said
        with robot.running("robot", port=robot.robot_port):
            assert await client.prompt("where are you?") == "end_turn"
            assert "I am at x" in client.said
        with robot.running("robot", port=robot.robot_port):
            assert await client.prompt("how is the battery?") == "end_turn"
            assert "The battery is at" in client.said
        await client.close()


async def test_a_model_without_a_key_is_told_by_name(tmp_path: Path) -> None:
    robot = Robot(tmp_path, {"ROBOT_ACP_AGENT__MODEL": "openai/gpt-4o-mini"})
    with robot.running("robot", port=robot.robot_port), robot.running("agent", port=robot.agent_port):
        client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
        await client.new()
        assert await client.prompt("hello") == "end_turn"
        assert "The model openai/gpt-4o-mini needs a key: set OPENAI_API_KEY" in client.said
        option = {"sessionId": client.session, "configId": "model", "value": "offline/commands"}
        await client.link.request("session/set_config_option", option)
        await client.prompt("where are you?")
        assert "I am at x" in client.said
        await client.close()


async def test_killing_the_agent_in_mid_turn_loses_nothing_that_was_seen(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    address = f"tcp://127.0.0.1:{robot.agent_port}"
    with robot.running("robot", port=robot.robot_port):
        with robot.running("agent", port=robot.agent_port) as agent:
            client = await Client.open(address)
            await client.new()
            async with robot.watched() as watched:
                turn = asyncio.create_task(client.prompt("go to lab 2.3.9"))
                await watched.until(lambda: watched.speed > 0.3, "the robot to drive")
                end(agent, signal.SIGKILL)
                await asyncio.gather(turn, return_exceptions=True)
                assert isinstance(turn.exception(), LinkError)
                await watched.until(lambda: watched.speed == 0, "the robot at rest", 5)
        with robot.running("agent", port=robot.agent_port):
            again = await Client.open(address)
            await again.load(client.session)
            assert again.numbers == list(range(1, len(again.numbers) + 1))
            assert again.updates[1 : len(client.updates) + 1] == client.updates
            assert "I was restarted in the middle of this" in again.said
            assert again.updates[-1]["_meta"]["robot-acp/turn"]["state"] == "ended"
            assert await again.prompt("come back") == "end_turn"
            assert "I am back where this session started." in again.said
            await again.close()
        await client.close()


async def test_the_agent_ends_in_order_and_the_robot_is_at_rest(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    with robot.running("robot", port=robot.robot_port), robot.running("agent", port=robot.agent_port) as agent:
        client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
        await client.new()
        async with robot.watched() as watched:
            client.later(client.prompt("go to lab 2.3.9"))
            await watched.until(lambda: watched.speed > 0.3, "the robot to drive")
            assert await asyncio.to_thread(end, agent) == 0
            assert watched.speed == 0
        await eventually(lambda: client.link.closed.done(), "the connection to end")
        await client.close()


def test_a_database_of_another_version_is_told_and_left_alone(tmp_path: Path) -> None:
    file = tmp_path / "sessions.db"
    with sqlite3.connect(file) as old:
        old.execute("CREATE TABLE sessions (id TEXT PRIMARY KEY, updated FLOAT)")
        old.execute("INSERT INTO sessions VALUES ('s1', 0)")
    robot = Robot(tmp_path)
    for arguments in (("agent",), ("sessions", "list")):
        process = robot.spawn(*arguments, stderr=subprocess.PIPE)
        _, error = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 2
        assert "was made by another version of robot-acp" in error
        assert "Traceback" not in error
    with sqlite3.connect(file) as old:
        assert old.execute("SELECT id FROM sessions").fetchall() == [("s1",)]


def test_a_database_that_cannot_be_used_is_told_without_its_password(tmp_path: Path) -> None:
    robot = Robot(tmp_path, {"ROBOT_ACP_AGENT__DATABASE": "nonsense://ana:hunter2@host/db"})
    process = robot.spawn("agent", stderr=subprocess.PIPE)
    _, error = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    assert "The database of sessions cannot be used" in error
    assert "hunter2" not in error
