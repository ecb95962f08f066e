"""Somebody else's ACP agent behind the bridge, and in front of it `connect`: neither end knows of the other."""

from __future__ import annotations

import shlex
import sys
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest

from backend.identity import Role
from tests.gateway.peers import connected, said, updates
from tests.processes import Client, Robot, eventually

SWEEPER = Path(__file__).with_name("third_party_agent.py")


@pytest.fixture(scope="module")
def sweeper(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """A bridge before the sweeper: no robot server and no agent of ours."""
    robot = Robot(tmp_path_factory.mktemp("sweeper"))
    command = shlex.join([sys.executable, str(SWEEPER)])
    with robot.running("bridge", "--agent", f"stdio:{command}", port=robot.bridge_port):
        yield robot


@pytest.fixture
async def client(sweeper: Robot) -> AsyncIterator[Client]:
    address = f"ws://127.0.0.1:{sweeper.bridge_port}/acp"
    client = await Client.open(address, sweeper.token("Ana", Role.OPERATOR), answer=None)
    yield client
    await client.close()


@pytest.mark.parametrize(
    ("option", "status", "words"),
    [("yes", "completed", "The floor is clean."), ("no", "failed", "Then it stays dirty.")],
)
async def test_its_question_and_its_work_reach_a_client(client: Client, option: str, status: str, words: str) -> None:
    client.answer = option
    await client.new()
    assert await client.prompt("sweep") == "end_turn"
    assert [question["params"]["toolCall"]["title"] for question in client.questions] == ["Sweep the floor"]
    [call] = [p["update"] for p in updates(client.heard) if p["update"]["sessionUpdate"] == "tool_call_update"]
    assert call["status"] == status
    assert said(client.heard) == words


async def test_its_prompt_can_be_cancelled(client: Client) -> None:
    await client.new()
    prompt = client.later(client.prompt("wait"))
    await eventually(lambda: said(client.heard) == "Waiting.", "its first words")
    await client.cancel()
    assert await prompt == "cancelled"


async def test_each_client_has_a_sweeper_of_its_own(sweeper: Robot, client: Client) -> None:
    await client.new()
    waiting = client.later(client.prompt("wait"))
    async with connected(sweeper, "--token", sweeper.token("Bo", Role.OPERATOR)) as editor:
        session = await editor.new_session()
        await editor.begin("sweep", "session/prompt", sessionId=session, prompt=[{"type": "text", "text": "sweep"}])
        question = await editor.until("session/request_permission")
        outcome = b'{"outcome":"selected","optionId":"yes"}'
        await editor.send(b'{"jsonrpc":"2.0","id":%d,"result":{"outcome":%s}}' % (question["id"], outcome))
        assert (await editor.answer_to("sweep"))["result"]["stopReason"] == "end_turn"
        assert editor.said == "The floor is clean."
        assert await editor.leave() == (0, "")
    assert not waiting.done()
    await client.cancel()
    assert await waiting == "cancelled"
