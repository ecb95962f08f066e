"""`robot-acp listen`: many TCP clients, each with a connection of its own, and no way in for a web page."""

from __future__ import annotations

import asyncio
import socket
import subprocess
from collections.abc import AsyncIterator, Iterator

import pytest

from backend.identity import Role
from tests.gateway.peers import HELLO, Lines, a_remote
from tests.processes import PATIENCE_S, Robot, free_port

SAYS_HELLO = b'{"jsonrpc":"2.0","id":1,"method":"initialize","params":{"protocolVersion":1}}'


@pytest.fixture(scope="module")
def port(robot: Robot) -> Iterator[int]:
    """Where the robot listens once more."""
    port = free_port()
    token = robot.token("Ana", Role.OPERATOR)
    with robot.running("listen", "--port", str(port), "--token", token, port=port):
        yield port


async def dial(port: int) -> Lines:
    return Lines(*await asyncio.open_connection("127.0.0.1", port))


@pytest.fixture
async def client(port: int) -> AsyncIterator[Lines]:
    client = await dial(port)
    yield client
    client.writer.close()


async def test_two_clients_have_a_connection_each(port: int, client: Lines) -> None:
    other = await dial(port)
    mine, theirs = await client.new_session(), await other.new_session()
    assert mine != theirs
    # The same request ids on both: neither gets the other's answers.
    stops = await asyncio.gather(client.prompt(mine, "where are you?"), other.prompt(theirs, "which places are there?"))
    assert stops == ["end_turn", "end_turn"]
    assert "I am at x" in client.said
    assert "lab 2.3.7" in other.said
    assert {m["params"]["sessionId"] for m in client.heard} == {mine}
    assert {m["params"]["sessionId"] for m in other.heard} == {theirs}
    other.writer.close()
    assert "sessions" in await client.request("session/list")


@pytest.mark.parametrize(
    "first",
    [
        b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: text/plain\r\n\r\n" + SAYS_HELLO,
        b"GET / HTTP/1.1\r\nUpgrade: websocket\r\n",
        b'{"jsonrpc":"2.0","id":1,"method":"session/list","params":{}}\n' + SAYS_HELLO,
        b'{"jsonrpc":"2.0","method":"initialize","params":{}}',
        b"{}",
        b"\xff",
        b"x" * (16 * 1024 * 1024 + 2),
    ],
    ids=["post", "websocket", "another request", "a notification", "no message", "no text", "no end"],
)
async def test_whoever_does_not_begin_with_initialize_is_cut_off(robot: Robot, first: bytes) -> None:
    port = free_port()
    async with a_remote() as remote:
        with robot.running("listen", remote.url, "--port", str(port), port=port):
            stranger = await dial(port)
            heard = b""
            try:
                await stranger.send(first)
                async with asyncio.timeout(PATIENCE_S):
                    heard = await stranger.reader.read()
            except ConnectionError:
                pass  # cut off while it still spoke
            stranger.writer.close()
            assert heard == b""
            # The next one is served, and the remote has heard of no other.
            client = await dial(port)
            await client.send(SAYS_HELLO)
            far = await remote.client()
            assert await far.recv() == SAYS_HELLO.decode()
            assert remote.arrived.empty()
            client.writer.close()
            await far.wait_closed()
            assert far.close_code == 1000


async def test_a_remote_that_is_not_there_is_told_to_each_client(robot: Robot) -> None:
    port = free_port()
    address = f"ws://127.0.0.1:{free_port()}/acp"
    with robot.running("listen", address, "--port", str(port), port=port):
        for _ in range(2):
            client = await dial(port)
            await client.begin("hello", "initialize", **HELLO)
            [answer] = await client.rest()
            assert answer["id"] == "hello"
            assert answer["error"]["message"].startswith(f"Nothing answers at {address}.")
            client.writer.close()


async def test_a_remote_that_is_lost_ends_that_client_alone(robot: Robot) -> None:
    port = free_port()
    async with a_remote() as remote:
        with robot.running("listen", remote.url, "--port", str(port), port=port):
            first, second = await dial(port), await dial(port)
            await first.begin(1, "initialize", **HELLO)
            far = await remote.client()
            await second.begin(2, "initialize", **HELLO)
            other = await remote.client()
            await far.close()
            [answer] = await first.rest()
            assert answer["id"] == 1
            assert "is lost" in answer["error"]["message"]
            await other.send('{"jsonrpc":"2.0","id":2,"result":{}}')
            assert await second.answer_to(2) == {"jsonrpc": "2.0", "id": 2, "result": {}}
            for client in (first, second):
                client.writer.close()


def test_a_port_in_use_is_told(robot: Robot) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        command = robot.command("listen", "--port", str(taken.getsockname()[1]))
        done = subprocess.run(command, env=robot.variables, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 1
    assert "address already in use" in done.stderr
    assert "Traceback" not in done.stderr


def test_it_is_reached_from_this_machine_alone(port: int) -> None:
    with socket.socket() as outside:
        outside.bind(("127.0.0.2", 0))  # an address of this machine that is not the one served
        assert outside.connect_ex(("127.0.0.2", port)) != 0
