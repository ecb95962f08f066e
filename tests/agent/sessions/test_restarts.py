"""Each process can die and come back; what people have seen stays, and they are told what to do."""

from __future__ import annotations

import asyncio
import signal
import subprocess
from pathlib import Path

import pytest

from backend.agent.acp import updates
from backend.agent.sessions.store import Event, SessionRow, Store, as_json
from backend.chat.link import LinkError, RefusedError
from tests.databases import Database, SQLite
from tests.processes import PATIENCE_S, Client, Robot, end, eventually

pytestmark = pytest.mark.processes


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


async def test_killing_the_agent_in_mid_turn_loses_nothing_that_was_seen(tmp_path: Path, database: Database) -> None:
    robot = Robot(tmp_path, {"ROBOT_ACP_AGENT__DATABASE": database.url})
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
                await watched.until(lambda: watched.speed == 0, "the robot at rest")
        with robot.running("agent", port=robot.agent_port):
            again = await Client.open(address)
            [listed] = (await again.link.request("session/list", {}))["sessions"]
            assert (listed["sessionId"], listed["title"]) == (client.session, "go to lab 2.3.9")
            await again.load(client.session)
            assert again.numbers == list(range(1, len(again.numbers) + 1))
            assert again.updates[1 : len(client.updates) + 1] == client.updates
            assert "I was restarted in the middle of this" in again.said
            assert again.updates[-1]["_meta"]["robot-acp/turn"]["state"] == "ended"
            assert await again.prompt("come back") == "end_turn"
            assert "I am back where this session started." in again.said
            await again.close()
        await client.close()


async def test_people_see_a_drive_whose_database_is_gone_and_all_of_it_is_kept(
    tmp_path: Path, database: Database
) -> None:
    robot = Robot(tmp_path, {"ROBOT_ACP_AGENT__DATABASE": database.url})
    address = f"tcp://127.0.0.1:{robot.agent_port}"
    with (
        robot.running("robot", "--time-scale", "5", port=robot.robot_port),
        robot.running("agent", port=robot.agent_port),
    ):
        client = await Client.open(address)
        await client.new()
        assert await client.prompt("where are you?") == "end_turn"
        with database.away():
            assert await client.prompt("go to lab 2.3.9") == "end_turn"
            assert "reached" in str(client.of("tool_call_update")[-1]), "the drive was shown to its end"
            with pytest.raises(RefusedError, match="The session log cannot be written"):
                await client.prompt("go to the kitchen")

        async def takes_prompts_again() -> bool:
            try:
                return await client.prompt("where are you?") == "end_turn"
            except RefusedError:
                return False

        async with asyncio.timeout(PATIENCE_S):
            while not await takes_prompts_again():
                pass
        again = await Client.open(address)
        await again.load(client.session)
        assert again.numbers == list(range(1, len(again.numbers) + 1))
        assert [u for u in again.updates if u["sessionUpdate"] != "user_message_chunk"] == client.updates
        assert [u["content"]["text"] for u in again.of("user_message_chunk")] == [
            "where are you?", "go to lab 2.3.9", "where are you?"
        ]  # fmt: skip
        await again.close()
        await client.close()


def test_a_second_agent_on_one_database_is_refused_and_people_can_read_it(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    with robot.running("agent", port=robot.agent_port):
        second = robot.spawn("agent", "--stdio", stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        _, error = second.communicate(timeout=PATIENCE_S)
        assert second.returncode == 2
        assert "Another agent is using the database of sessions, and a robot has one agent." in error
        assert "Traceback" not in error
        assert robot.spawn("sessions", "list").wait(PATIENCE_S) == 0


async def test_a_very_long_session_loads_and_its_model_gets_a_bounded_past(tmp_path: Path) -> None:
    database = SQLite(tmp_path / "sessions.db")
    await keep_a_long_past(database, turns=2500)
    robot = Robot(tmp_path, {"ROBOT_ACP_AGENT__DATABASE": database.url})
    with robot.running("robot", port=robot.robot_port), robot.running("agent", port=robot.agent_port):
        client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
        await client.load("long")
        assert client.numbers == list(range(1, 5001)), "the log is never shortened"
        assert await client.prompt("where are you?") == "end_turn"
        assert "I am at x" in client.said
        # Of 250,000 words of the past, the model got what fits into 60,000 characters.
        assert 60_000 / 10 < client.of("usage_update")[-1]["used"] < 60_000 / 4
        await client.close()


async def keep_a_long_past(database: Database, turns: int) -> None:
    """A session of many short turns: a question and an answer of a hundred words in all."""
    store = Store(database.url)
    await store.open()
    await store.add_session(SessionRow("long", "Ana", None, "/", "supervised", "offline/commands", None, 0.0, 0.0))
    past: list[updates.Update] = []
    for number in range(turns):
        past.append(updates.user_message(updates.text_block("words " * 50), "Ana", str(number)))
        past.append(updates.message("words " * 50) | {"_meta": updates.turn_ended(str(number), "end_turn")["_meta"]})
    await store.append([Event("long", seq, 0.0, as_json(update)) for seq, update in enumerate(past, 1)])
    await store.close()


async def test_the_agent_ends_in_order_and_the_robot_is_at_rest(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    with robot.running("robot", port=robot.robot_port), robot.running("agent", port=robot.agent_port) as agent:
        client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
        await client.new()
        async with robot.watched() as watched:
            client.later(client.prompt("go to lab 2.3.9"))
            await watched.until(lambda: watched.speed > 0.3, "the robot to drive")
            assert await asyncio.to_thread(end, agent) == 0
            assert await robot.stands()
        await eventually(lambda: client.link.closed.done(), "the connection to end")
        await client.close()


def test_a_database_that_cannot_be_used_is_told_without_its_password(tmp_path: Path) -> None:
    """What is told of each kind of trouble: `test_database.py`."""
    robot = Robot(tmp_path, {"ROBOT_ACP_AGENT__DATABASE": "postgresql://ana:hunter2@127.0.0.1:1/db"})
    for arguments in (("agent",), ("sessions", "list")):
        process = robot.spawn(*arguments, stderr=subprocess.PIPE)
        _, error = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 2
        assert "The database of sessions cannot be used" in error
        assert "Traceback" not in error
        assert "hunter2" not in error
