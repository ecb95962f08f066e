"""An answer "always" counts for the tool that people saw: for no other server under its name, and no other schema."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.processes import Client, Robot, end, free_port, listens, wait_until

HERE = Path(__file__).parents[1]


@contextlib.contextmanager
def speaking(port: int, *arguments: str) -> Iterator[None]:
    process = subprocess.Popen([sys.executable, str(HERE / "speaking_server.py"), str(port), *arguments], text=True)
    try:
        wait_until(lambda: listens(port), "the server to answer")
        yield
    finally:
        end(process)


@pytest.fixture(scope="module")
def ports() -> tuple[int, int]:
    return free_port(), free_port()


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory, ports: tuple[int, int]) -> Iterator[Robot]:
    """The agent of a robot that cannot speak; a client may bring a server at each of the two ports."""
    variables = {
        "ROBOT_ACP_AGENT__ROBOT_URL": f"stdio:{sys.executable} {HERE / 'quiet_robot.py'}",
        "ROBOT_ACP_AGENT__MCP_ALLOW": json.dumps([url(port) for port in ports]),
    }
    robot = Robot(tmp_path_factory.mktemp("data"), variables)
    with robot.running("agent", port=robot.agent_port):
        yield robot


def url(port: int) -> str:
    return f"http://127.0.0.1:{port}/mcp"


async def open_with(client: Client, port: int) -> dict[str, Any]:
    """Open the session with the server at this port, always under the same name."""
    servers = [{"type": "http", "name": "lab", "url": url(port), "headers": []}]
    if not client.session:
        answer = await client.link.request("session/new", {"cwd": "/", "mcpServers": servers})
        client.session = answer["sessionId"]
        return answer
    params = {"sessionId": client.session, "cwd": "/", "mcpServers": servers}
    return await client.link.request("session/resume", params)


async def questions_for_speaking(client: Client) -> int:
    """How often people are asked when the robot is to speak."""
    client.questions.clear()
    assert await client.prompt("say hello") == "end_turn"
    return len(client.questions)


@pytest.mark.parametrize(("option", "allowed"), [("allow_always", True), ("reject_always", False)])
async def test_another_server_under_the_same_name_inherits_no_answer(
    robot: Robot, ports: tuple[int, int], option: str, allowed: bool
) -> None:
    first, second = ports
    client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}", answer=option)
    with speaking(first), speaking(second):
        await open_with(client, first)
        assert [await questions_for_speaking(client) for _ in range(2)] == [1, 0]
        client.answer = "reject_once"
        await open_with(client, second)
        assert [await questions_for_speaking(client) for _ in range(2)] == [1, 1]
        answer = await open_with(client, first)
        assert answer["_meta"]["robot-acp/remembered"] == {"lab__speak": allowed}
        assert await questions_for_speaking(client) == 0
    await client.close()


async def test_a_tool_whose_schema_has_changed_is_asked_about_again(robot: Robot, ports: tuple[int, int]) -> None:
    client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}", answer="allow_always")
    with speaking(ports[0]):
        await open_with(client, ports[0])
        assert [await questions_for_speaking(client) for _ in range(2)] == [1, 0]
    with speaking(ports[0], "louder"):
        await open_with(client, ports[0])
        assert [await questions_for_speaking(client) for _ in range(2)] == [1, 0]
    with speaking(ports[0]):
        await open_with(client, ports[0])
        assert await questions_for_speaking(client) == 0
    await client.close()
