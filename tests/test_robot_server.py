"""The client of the robot server: no proxy, one connection that stays open, a second try where that is safe."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import pytest

from backend import dial, identity
from backend.identity import Role
from backend.robot_address import is_loopback
from backend.robot_server import NotStopped, RobotError, RobotServerClient
from tests.processes import Client, Robot, eventually
from tests.proxies import proxy

TELEMETRY = {"_meta": {"robot-acp/telemetry": {"rate": 10}}}


async def test_no_proxy_of_the_environment_is_between_us_and_the_robot(tmp_path: Path) -> None:
    with proxy() as seen:
        robot = Robot(tmp_path, seen.variables)
        with robot.at_work():
            client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}", capabilities=TELEMETRY)
            await client.new()
            await client.prompt("where are you?")
            assert "I am at x" in client.said
            await eventually(lambda: any(message["params"].get("online") for message in client.heard), "telemetry")
            assert (await client.link.request("_robot/stop", {}))["stopped"]
            bearer = {"Authorization": f"Bearer {robot.token('Sue', Role.SUPERVISOR)}"}
            base = f"http://127.0.0.1:{robot.bridge_port}"
            async with httpx.AsyncClient(base_url=base, headers=bearer, trust_env=False, timeout=30) as http:
                assert (await http.post("/api/stop")).json()["stopped"]
                assert (await http.post("/api/release")).json() == {"stopped": None}
            await client.close()
        assert seen.requests == []


async def test_a_model_is_still_reached_through_the_proxy_of_the_environment(tmp_path: Path) -> None:
    with proxy() as seen:
        model = {"OPENAI_API_BASE": "http://model.example/v1", "OPENAI_API_KEY": "k"}
        robot = Robot(tmp_path, seen.variables | model | {"ROBOT_ACP_AGENT__MODEL": "openai/some-model"})
        with robot.at_work(bridge=False):
            client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
            await client.new()
            await client.prompt("where are you?")
            await client.close()
        assert any("http://model.example/v1/chat/completions" in request for request in seen.requests)
        secret = robot.robot_headers["Authorization"]
        assert not any(secret in request for request in seen.requests)


@pytest.mark.parametrize(("url", "through"), [("ws://robot.invalid/acp", False), ("wss://robot.invalid/acp", True)])
async def test_a_login_goes_through_a_proxy_only_inside_tls(
    url: str, through: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    with proxy() as seen:
        for name, value in seen.variables.items():
            monkeypatch.setenv(name, value)
        with pytest.raises(Exception):  # noqa: B017, PT011 - the name is nobody's, or the proxy refuses
            await dial.dial(dial.Address.parse(url, "a login token"))
        assert bool(seen.requests) is through
        assert not any("a login token" in request for request in seen.requests)


@pytest.mark.parametrize(
    ("url", "local"),
    [
        ("http://127.0.0.1:1/mcp", True),
        ("http://localhost/mcp", True),
        ("http://[::1]:1/mcp", True),
        ("http://127.0.0.1.example/mcp", False),
        ("https://tools.example.org/mcp", False),
    ],
)
def test_what_is_on_this_machine(url: str, local: bool) -> None:
    assert is_loopback(url) is local


@dataclass
class Counted:
    """A forwarder in front of a server: it counts connections, and the requests on each."""

    target: int
    port: int = 0
    connections: list[bytearray] = field(default_factory=list)
    healthy: int = 0
    """Answers that say so."""

    async def forward(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        sent = bytearray()
        self.connections.append(sent)
        there, back = await asyncio.open_connection("127.0.0.1", self.target)

        async def copy(source: asyncio.StreamReader, sink: asyncio.StreamWriter, *, note: bool) -> None:
            with contextlib.suppress(OSError):
                while data := await source.read(65536):
                    if note:
                        sent.extend(data)
                    sink.write(data)
                    await sink.drain()
                    self.healthy += data.count(b'"status":"ok"')
            sink.close()

        with contextlib.suppress(asyncio.CancelledError):  # the test is over
            await asyncio.gather(copy(reader, back, note=True), copy(there, writer, note=False))

    def asked(self, line: bytes) -> int:
        return sum(connection.count(line) for connection in self.connections)


@contextlib.asynccontextmanager
async def counted(target: int) -> AsyncIterator[Counted]:
    forwarder = Counted(target)
    server = await asyncio.start_server(forwarder.forward, "127.0.0.1", 0)
    forwarder.port = server.sockets[0].getsockname()[1]
    yield forwarder
    server.close()


async def test_a_stop_through_the_agent_opens_no_connection(tmp_path: Path) -> None:
    """Also after more than the 5 s in which the robot server closes a connection that nobody uses."""
    robot = Robot(tmp_path)
    with robot.running("robot", port=robot.robot_port):
        async with counted(robot.robot_port) as between:
            agent = Robot(tmp_path, robot_port=between.port)
            with agent.running("agent", port=agent.agent_port):
                client = await Client.open(f"tcp://127.0.0.1:{agent.agent_port}")
                await eventually(lambda: between.healthy > 4, "some signs of life")
                before = len(between.connections)
                assert (await client.link.request("_robot/stop", {}))["stopped"]
                assert between.asked(b"POST /stop") == 1
                assert len(between.connections) == before
                assert max(connection.count(b"GET /health") for connection in between.connections) > 3
                await client.close()


async def test_the_first_stop_after_a_restart_of_the_robot_server_reaches_it(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    server = client_of(robot)
    with robot.running("robot", port=robot.robot_port):
        assert (await server.stop("Ana"))["stopped"]["by"] == "Ana"
        assert await server.release("Ana") == {"stopped": None}
    with robot.running("robot", port=robot.robot_port):
        assert (await server.stop("Ben"))["stopped"]["by"] == "Ben"
    with robot.running("robot", port=robot.robot_port):
        assert await server.release("Ana") == {"stopped": None}
        assert (await server.health())[0]
    with pytest.raises(NotStopped, match="The robot cannot be reached to stop it"):
        await server.stop("Ana")
    with pytest.raises(RobotError, match="The robot cannot be reached"):
        await server.release("Ana")
    await server.close()


def client_of(robot: Robot) -> RobotServerClient:
    secret = identity.shared_secret(robot.data, identity.ROBOT_TOKEN)
    return RobotServerClient(f"http://127.0.0.1:{robot.robot_port}", secret)


@contextlib.asynccontextmanager
async def answering(answers: dict[bytes, bytes | None]) -> AsyncIterator[tuple[RobotServerClient, list[bytes]]]:
    """A client of a server that answers each path with these bytes, or hangs up; and the first line of each request."""
    lines: list[bytes] = []

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = await reader.readuntil(b"\r\n\r\n")
        lines.append(head.split(b"\r\n")[0])
        path = head.split()[1].partition(b"?")[0]
        if (answer := answers.get(path)) is not None:
            writer.write(answer)
        writer.close()

    listener = await asyncio.start_server(serve, "127.0.0.1", 0)
    server = RobotServerClient(f"http://127.0.0.1:{listener.sockets[0].getsockname()[1]}", b"secret")
    yield server, lines
    await server.close()
    listener.close()


def http(status: str, body: bytes, kind: str = "application/json") -> bytes:
    return f"HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nConnection: close\r\n\r\n".encode() + body


async def test_a_stop_is_sent_again_where_the_answer_is_lost_and_a_release_is_not() -> None:
    async with answering({b"/health": http("200 OK", b"{}")}) as (server, lines):
        with pytest.raises(NotStopped):
            await server.stop("Ana")
        assert [line.split(b"?")[0] for line in lines] == [b"POST /stop", b"POST /stop"]
        lines.clear()
        with pytest.raises(RobotError, match="The robot cannot be reached"):
            await server.release("Ana")
        assert [line.split(b"?")[0].removesuffix(b" HTTP/1.1") for line in lines] == [b"GET /health", b"POST /release"]


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (http("200 OK", b"<html>Welcome to this hotel</html>", "text/html"), "did not confirm the stop"),
        (http("200 OK", b"{}"), "did not confirm the stop"),
        (http("200 OK", b'{"stopped": true}'), "did not confirm the stop"),
        (http("200 OK", b'{"stopped": null}'), "did not confirm the stop"),
        (http("200 OK", b"[]"), "did not confirm the stop"),
        (http("200 OK", b'{"stopped": {}, "more": "' + b"x" * 100_000 + b'"}'), "did not confirm the stop"),
        (http("302 Found", b""), "did not confirm the stop"),
        (http("401 Unauthorized", b'{"stopped": {"by": "x"}}'), "did not confirm the stop"),
        (http("500 Internal Server Error", b""), "did not confirm the stop"),
        (http("404 Not Found", b""), "has no stop path here"),
        (http("405 Method Not Allowed", b""), "has no stop path here"),
        (b"no HTTP at all\r\n\r\n", "cannot be reached"),
    ],
)
async def test_only_the_robots_own_confirmation_counts_as_stopped(answer: bytes, sentence: str) -> None:
    async with answering({b"/stop": answer}) as (server, _):
        with pytest.raises(NotStopped, match=sentence) as refused:
            await server.stop("Ana")
    assert str(refused.value).endswith("Use the stop button on the robot.")


async def test_an_answer_without_end_is_not_read_to_its_end() -> None:
    written = 0

    async def serve(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal written
        with contextlib.suppress(OSError):
            writer.write(b"HTTP/1.1 200 OK\r\n\r\n")
            while True:
                writer.write(b" " * 65536)
                written += 65536
                await writer.drain()

    listener = await asyncio.start_server(serve, "127.0.0.1", 0)
    server = RobotServerClient(f"http://127.0.0.1:{listener.sockets[0].getsockname()[1]}")
    with pytest.raises(NotStopped, match="did not confirm"):
        await server.stop("Ana")
    assert written < 64 * 1024 * 1024
    await server.close()
    listener.close()


async def test_without_paths_there_is_nothing_to_reach() -> None:
    server = RobotServerClient(None)
    with pytest.raises(NotStopped, match="no stop path here"):
        await server.stop("Ana")
    with pytest.raises(RobotError, match="no path that releases"):
        await server.release("Ana")
    await server.forget_preview("1")
    await server.keep_warm()
    await server.close()
