"""`robot-acp connect` before the whole robot: what a stdio client sees, and how it ends."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import pytest
from acp import PROTOCOL_VERSION, spawn_agent_process, text_block
from acp.schema import AgentMessageChunk, ClientCapabilities, TextContentBlock

from backend import tokens
from backend.identity import Role
from tests.gateway.peers import HELLO, connected, updates
from tests.processes import PATIENCE_S, Client, Robot, end, eventually, free_port


async def test_a_stdio_client_hears_what_a_websocket_client_hears(robot: Robot) -> None:
    token = robot.token("Ana", Role.SUPERVISOR)
    async with connected(robot, "--token", token) as editor:
        session = await editor.new_session()
        watcher = await Client.open(f"ws://127.0.0.1:{robot.bridge_port}/acp", robot.token("Bo", Role.SUPERVISOR))
        await watcher.load(session)

        assert await editor.prompt(session, "where are you?") == "end_turn"

        assert "I am at x" in editor.said
        mine = events(editor.heard)
        await eventually(lambda: max(mine) in events(watcher.heard), "the watcher's last event")
        theirs = events(watcher.heard)
        assert list(mine) == sorted(mine)
        assert {n: theirs[n] for n in mine} == mine
        unseen = [theirs[n]["update"]["sessionUpdate"] for n in theirs if n not in mine]
        assert unseen == ["user_message_chunk"]  # who sent it knows it
        await watcher.close()
        assert await editor.leave() == (0, "")


def events(heard: list[dict[str, Any]]) -> dict[int, dict[str, Any]]:
    """The numbered updates: those of the session, and not of one connection."""
    return {params["_meta"]["robot-acp/seq"]: params for params in updates(heard) if "_meta" in params}


class Editor:
    """A client of the official SDK that keeps what the robot says."""

    def __init__(self) -> None:
        self.said = ""

    async def session_update(self, session_id: str, update: Any, **_kwargs: Any) -> None:
        if isinstance(update, AgentMessageChunk) and isinstance(update.content, TextContentBlock):
            self.said += update.content.text


async def test_the_official_sdk_takes_it_for_a_local_agent(robot: Robot) -> None:
    editor = Editor()
    # The SDK gives the process a bare environment: all it knows is on its command line.
    address = f"ws://127.0.0.1:{robot.bridge_port}/acp"
    command = robot.command("connect", address, "--token", robot.token("Ana", Role.OPERATOR))
    patiently = {"shutdown_timeout": PATIENCE_S}
    async with spawn_agent_process(editor, *command, transport_kwargs=patiently) as (agent, process):  # type: ignore[arg-type]
        hello = await agent.initialize(PROTOCOL_VERSION, ClientCapabilities())
        assert hello.agent_capabilities is not None
        assert hello.agent_capabilities.load_session
        session = await agent.new_session(cwd="/", mcp_servers=[])
        answer = await agent.prompt(session_id=session.session_id, prompt=[text_block("where are you?")])
        assert answer.stop_reason == "end_turn"
        await eventually(lambda: "I am at x" in editor.said, "what the robot says")
    assert process.returncode == 0  # closing its stdin was enough


async def test_the_token_may_be_a_variable_and_the_local_bridge_is_the_default(robot: Robot) -> None:
    here = Robot(robot.data, {"ROBOT_ACP_TOKEN": robot.token("Vic", Role.VIEWER)}, bridge_port=robot.bridge_port)
    async with connected(here) as editor:
        hello = await editor.request("initialize", **HELLO)
        assert hello["agentCapabilities"]["_meta"]["robot-acp"]["role"] == "viewer"


async def test_over_tcp_the_token_counts_too(robot: Robot) -> None:
    address = f"tcp://127.0.0.1:{robot.agent_port}"
    async with connected(robot, address, "--token", robot.token("Vic", Role.VIEWER)) as editor:
        hello = await editor.request("initialize", **HELLO)
        assert hello["agentCapabilities"]["_meta"]["robot-acp"]["role"] == "viewer"
        assert await editor.leave() == (0, "")


async def test_a_bad_line_is_answered_and_ends_nothing(robot: Robot) -> None:
    async with connected(robot, "--token", robot.token("Ana", Role.OPERATOR)) as editor:
        await editor.request("initialize", **HELLO)
        for line, code in ((b"{", -32700), (b"\xff", -32700), (b"[]", -32600), (b'{"jsonrpc":"1.0","id":7}', -32600)):
            await editor.send(line)
            assert (await editor.message())["error"]["code"] == code
        await editor.send(b" " * (16 * 1024 * 1024 + 1))
        assert "larger than" in (await editor.message())["error"]["message"]
        assert "sessions" in await editor.request("session/list")


async def test_a_wrong_token_is_told(robot: Robot) -> None:
    async with connected(robot, "--token", "nonsense") as editor:
        await editor.begin(1, "initialize", **HELLO)
        status, words = await editor.ended()
        assert status == 1
        assert words.splitlines() == [words.strip()]
        assert "did not accept this login. Make a token with `robot-acp token create`" in words
        assert await editor.rest() == []


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("ws://127.0.0.1:{free}/acp", "Nothing answers at ws://127.0.0.1:{free}/acp. Is the robot running?"),
        ("tcp://127.0.0.1:{free}", "Nothing answers at tcp://127.0.0.1:{free}. Is the robot running?"),
        ("ws://127.0.0.1:{agent}", "ws://127.0.0.1:{agent}/acp does not speak WebSocket. Is the address right?"),
        ("ws://127.0.0.1:{bridge}/nowhere", "The address of a bridge ends in /acp."),
        ("wss://127.0.0.1:{bridge}/acp", "No safe connection to wss://127.0.0.1:{bridge}/acp: "),
        ("http://127.0.0.1:{bridge}", "is no address. Give wss://HOST/acp"),
        ("tcp://127.0.0.1", "is no address. Give wss://HOST/acp"),
        ("ws://127.0.0.1:x/acp", "is no address. Give wss://HOST/acp"),
    ],
)
async def test_an_address_that_does_not_serve_is_told(robot: Robot, address: str, words: str) -> None:
    ports = {"free": free_port(), "agent": robot.agent_port, "bridge": robot.bridge_port}
    async with connected(robot, address.format(**ports), "--token", robot.token("Ana", Role.OPERATOR)) as editor:
        status, told = await editor.ended()
        assert status == (2 if "no address" in words else 1)
        assert words.format(**ports) in told
        assert told.count("\n") == 1
        assert await editor.rest() == []


async def test_a_bridge_that_dies_leaves_no_request_without_an_answer(robot: Robot) -> None:
    own = Robot(robot.data, robot_port=robot.robot_port, agent_port=robot.agent_port)
    with own.running("bridge", port=own.bridge_port) as bridge:
        async with connected(own, "--token", own.token("Ana", Role.SUPERVISOR)) as editor:
            session = await editor.new_session()
            # The agent's question has the id p1, too: the two directions count for themselves.
            await editor.begin(
                "p1", "session/prompt", sessionId=session, prompt=[{"type": "text", "text": "say hello"}]
            )
            question = await editor.until("session/request_permission")
            assert question["id"] == "p1"

            bridge.kill()

            answer = await editor.answer_to("p1")
            assert answer["error"]["code"] == -32603
            assert "is lost" in answer["error"]["message"]
            assert await editor.rest() == []
            status, words = await editor.ended()
            assert status == 1
            assert words == f"robot-acp: {answer['error']['message']}\n"
            assert "Check that the robot is running, then connect again." in words


async def test_an_agent_that_dies_is_told_over_tcp_as_well(robot: Robot) -> None:
    own = robot.with_another_agent()
    with own.running("agent", port=own.agent_port) as agent:
        async with connected(own, f"tcp://127.0.0.1:{own.agent_port}") as editor:
            await editor.request("initialize", **HELLO)
            end(agent)
            status, words = await editor.ended()
            assert status == 1
            assert f"The connection to tcp://127.0.0.1:{own.agent_port} is lost" in words


async def test_a_revoked_token_ends_it_with_the_reason(robot: Robot) -> None:
    async with connected(robot, "--token", robot.token("Rita", Role.OPERATOR)) as editor:
        await editor.request("initialize", **HELLO)
        tokens.revoke(robot.data, "Rita")
        status, words = await editor.ended()
        assert status == 1
        assert "Your login was revoked. Ask for a new one. Pass the new token with --token" in words


def test_without_a_word_from_the_client_it_ends_politely(robot: Robot) -> None:
    done = subprocess.run(
        robot.command("connect", "--token", robot.token("Ana", Role.OPERATOR)),
        env=robot.variables,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=PATIENCE_S,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")


def test_it_starts_without_the_robots_own_libraries(robot: Robot) -> None:
    """An editor starts it for each window: it has to be light."""
    program = (
        "import sys, backend.cli, backend.gateway.connect, backend.gateway.listen; print(json.dumps([*sys.modules]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", f"import json; {program}"],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=True,
    )
    assert not {"litellm", "viser", "fastapi", "sqlalchemy", "mcp", "numpy"} & set(json.loads(done.stdout))
