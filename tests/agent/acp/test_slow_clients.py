"""A client that does not read: nobody waits for it, it is cut off, and it goes on where it was.

The slow ones here are real connections with small buffers, so that what they do not read has to wait in the agent.
"""

from __future__ import annotations

import asyncio
import base64
import json
import socket
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import pytest
from acp.router import MessageRouter
from websockets.asyncio.client import ClientConnection as WebSocket
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from backend.agent.acp.connection import ClientConnection
from backend.agent.acp.telemetry import MAX_HZ, TelemetryFeed
from backend.agent.control.lease import Lease
from backend.agent.robot.robot_client import RobotClient
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.store import Store
from backend.agent.wiring import Wiring
from backend.config import Settings
from backend.identity import Identity, Role
from backend.robot_server import RobotServerClient
from backend.telemetry import Battery, Pose, State, Twist
from tests.processes import PATIENCE_S, Client, Robot, eventually, trusted

OUTBOX_BYTES = 4 * 1024 * 1024
PICTURE = base64.b64encode(bytes(900_000)).decode()
"""1.2 MB as text: one event of this size is more than a replay keeps ready for a client."""
PICTURES = 16
"""Together more than the outbox and the kernel's buffers for sending hold."""
STATE = State(0.0, "Sancho", Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0), Battery(1.0, False), None, None, None)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """Robot server, agent and bridge, which lets four megabytes wait for each client."""
    robot = Robot(tmp_path_factory.mktemp("data"), {"ROBOT_ACP_AGENT__MAX_OUTBOX_BYTES": str(OUTBOX_BYTES)})
    with (
        robot.running("robot", "--time-scale", "20", port=robot.robot_port),
        robot.running("agent", port=robot.agent_port),
        robot.running("bridge", port=robot.bridge_port),
    ):
        yield robot


@pytest.fixture
async def worker(robot: Robot) -> AsyncIterator[Client]:
    """Somebody who works with the robot, and reads."""
    client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
    await client.new()
    yield client
    await client.close()


def small_socket(port: int) -> socket.socket:
    """A connection whose kernel buffer holds little."""
    plug = socket.socket()
    plug.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 16 * 1024)
    plug.connect(("127.0.0.1", port))
    plug.setblocking(False)
    return plug


def hung_up(plug: socket.socket) -> bool:
    """Whether the other end has closed; reading would only tell after all that was sent before."""
    ours, theirs = plug.getsockname()[1], plug.getpeername()[1]
    for line in Path("/proc/net/tcp").read_text().splitlines()[1:]:
        local, remote, state = line.split()[1:4]
        if (local[-4:], remote[-4:]) == (f"{theirs:04X}", f"{ours:04X}"):
            return state != "01"  # established
    return True


class Slow:
    """A client that reads only when it is told to. `heard` is every whole message so far."""

    def __init__(self, plug: socket.socket) -> None:
        self.plug = plug
        self.heard: list[dict[str, Any]] = []

    async def send(self, text: str) -> None:
        raise NotImplementedError

    async def read(self) -> bool:
        """Read a little; false once the connection has ended."""
        raise NotImplementedError

    async def close(self) -> None:
        raise NotImplementedError

    async def ask(self, request_id: int, method: str, params: dict[str, Any]) -> None:
        message = {"jsonrpc": "2.0", "id": request_id, "method": method, "params": params}
        await self.send(json.dumps(message))

    async def until_answered(self, request_id: int) -> None:
        await self.read_until(lambda: any(m.get("id") == request_id and "result" in m for m in self.heard))

    async def read_until(self, condition: Callable[[], bool]) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while not condition():
                assert await self.read(), "the connection has ended"

    async def cut_off(self) -> None:
        """Wait, reading nothing, until the other end has had enough; then read what it had sent."""
        await eventually(lambda: hung_up(self.plug), "the slow client to be cut off")
        async with asyncio.timeout(PATIENCE_S):
            while await self.read():
                pass

    def events_of(self, session: str) -> list[tuple[int, dict[str, Any]]]:
        shown = [m["params"] for m in self.heard if m.get("method") == "session/update" and "_meta" in m["params"]]
        return [(p["_meta"]["robot-acp/seq"], p["update"]) for p in shown if p["sessionId"] == session]


class SlowTcp(Slow):
    """Over TCP, straight to the agent."""

    @classmethod
    async def open(cls, robot: Robot) -> SlowTcp:
        client = cls(small_socket(robot.agent_port))
        client.reader, client.writer = await asyncio.open_connection(sock=client.plug)
        return client

    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter
    rest = b""

    async def send(self, text: str) -> None:
        self.writer.write(text.encode() + b"\n")
        await self.writer.drain()

    async def read(self) -> bool:
        try:
            data = await self.reader.read(65536)
        except ConnectionError:
            return False
        *lines, self.rest = (self.rest + data).split(b"\n")
        self.heard += [json.loads(line) for line in lines]
        return data != b""

    async def close(self) -> None:
        self.writer.close()


class SlowWebSocket(Slow):
    """Over the bridge's WebSocket, as a browser."""

    wire: WebSocket

    @classmethod
    async def open(cls, robot: Robot) -> SlowWebSocket:
        client = cls(small_socket(robot.bridge_port))
        client.wire = await connect(
            f"ws://127.0.0.1:{robot.bridge_port}/acp",
            additional_headers={"Authorization": f"Bearer {robot.token('Ana', Role.SUPERVISOR)}"},
            sock=client.plug,
            max_queue=1,
            max_size=None,
            ping_interval=None,
        )
        return client

    async def send(self, text: str) -> None:
        await self.wire.send(text)

    async def read(self) -> bool:
        try:
            self.heard.append(json.loads(await self.wire.recv()))
        except ConnectionClosed:
            return False
        return True

    async def close(self) -> None:
        await self.wire.close()


async def work(worker: Client, turns: int) -> None:
    """Turns whose events are large: a picture comes with each prompt."""
    picture = {"type": "image", "mimeType": "image/png", "data": PICTURE}
    blocks = [{"type": "text", "text": "where are you?"}, picture]
    for _ in range(turns):
        async with asyncio.timeout(PATIENCE_S):
            answer = await worker.link.request("session/prompt", {"sessionId": worker.session, "prompt": blocks})
        assert answer["stopReason"] == "end_turn"


async def the_log(robot: Robot, session: str) -> list[tuple[int, dict[str, Any]]]:
    """All events of a session, read in good time."""
    reader = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}", answer=None)
    await reader.load(session)
    events = list(zip(reader.numbers, reader.updates, strict=True))
    await reader.close()
    assert [number for number, _ in events] == list(range(1, len(events) + 1))
    return events


async def the_rest(robot: Robot, worker: Client, slow: Slow) -> list[tuple[int, dict[str, Any]]]:
    """What a client that comes back gets, while the other one goes on working."""
    back = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}", answer=None)
    turn = worker.later(work(worker, 1))
    after = {"robot-acp/after": slow.events_of(worker.session)[-1][0]}
    await back.link.request("session/resume", {"sessionId": worker.session, "cwd": "/", "_meta": after})
    await turn
    await eventually(lambda: back.numbers[-1] == worker.numbers[-1], "the last event")
    rest = list(zip(back.numbers, back.updates, strict=True))
    await back.close()
    return rest


@pytest.mark.parametrize("dial", [SlowTcp.open, SlowWebSocket.open], ids=["tcp", "websocket"])
async def test_a_client_that_stops_reading_is_cut_off_and_resumes_where_it_was(
    robot: Robot, worker: Client, dial: Callable[[Robot], Awaitable[Slow]]
) -> None:
    await work(worker, 1)
    slow = await dial(robot)
    await slow.ask(1, "initialize", {"protocolVersion": 1})
    await slow.ask(2, "session/load", {"sessionId": worker.session, "cwd": "/", "mcpServers": []})
    await slow.until_answered(2)
    had = slow.events_of(worker.session)[-1][0]

    await work(worker, PICTURES)  # meanwhile the slow one reads nothing
    await slow.cut_off()
    await slow.close()
    got, everything = slow.events_of(worker.session), await the_log(robot, worker.session)
    assert had < got[-1][0] < everything[-1][0]
    assert got == everything[: len(got)]

    assert got + await the_rest(robot, worker, slow) == await the_log(robot, worker.session)


async def test_a_client_that_stops_reading_in_a_replay_is_cut_off_and_resumes_where_it_was(
    robot: Robot, worker: Client
) -> None:
    await work(worker, PICTURES)
    before = worker.numbers[-1]
    slow = await SlowTcp.open(robot)
    await slow.ask(1, "initialize", {"protocolVersion": 1})
    await slow.until_answered(1)
    await slow.ask(2, "session/load", {"sessionId": worker.session, "cwd": "/", "mcpServers": []})
    await slow.read_until(lambda: slow.events_of(worker.session) != [])

    await work(worker, PICTURES)  # what happens during the replay has to wait for its end
    await slow.cut_off()
    await slow.close()
    got, everything = slow.events_of(worker.session), await the_log(robot, worker.session)
    assert got[-1][0] < before
    assert got == everything[: len(got)]

    assert got + await the_rest(robot, worker, slow) == await the_log(robot, worker.session)


async def test_a_slow_replay_and_the_events_of_another_session_share_a_connection(robot: Robot, worker: Client) -> None:
    await work(worker, PICTURES)
    long, other = worker.session, await worker.new()
    await work(worker, 1)
    slow = await SlowTcp.open(robot)
    await slow.ask(1, "initialize", {"protocolVersion": 1})
    await slow.ask(2, "session/load", {"sessionId": other, "cwd": "/", "mcpServers": []})
    await slow.until_answered(2)
    await slow.ask(3, "session/load", {"sessionId": long, "cwd": "/", "mcpServers": []})
    await slow.read_until(lambda: slow.events_of(long) != [])

    await work(worker, 1)
    await slow.until_answered(3)
    await work(worker, 1)
    last = worker.numbers[-1]
    await slow.read_until(lambda: slow.events_of(other)[-1][0] == last)
    await slow.close()
    assert slow.events_of(long) == await the_log(robot, long)
    assert slow.events_of(other) == await the_log(robot, other)


async def test_old_telemetry_does_not_pile_up_for_a_client_that_does_not_read() -> None:
    link = RobotClient(RobotServerClient(None))
    journal = Journal(Store("sqlite://"))
    wiring = SimpleNamespace(link=link, journal=journal, turns=SimpleNamespace(lease=Lease()), settings=Settings())
    told = 40_000  # 14 MB, if all of it were kept
    served = asyncio.Event()

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        connection = ClientConnection(reader, writer, trusted=trusted, max_outbox_bytes=OUTBOX_BYTES)
        connection.identity = Identity("Ana", Role.VIEWER)
        serving = asyncio.create_task(connection.serve(MessageRouter()))
        feed = TelemetryFeed(cast(Wiring, wiring), connection, MAX_HZ)
        for number in range(told):
            # A robot that speaks all the time: each change of what it says goes out at once.
            await link._set(msgspec.structs.replace(STATE, time=number, speaking=str(number)))
            await asyncio.sleep(0)
        connection.deliver(b'{"last":true}\n')
        served.set()
        await serving
        feed.close()

    server = await asyncio.start_server(accept, "127.0.0.1", 0)
    slow = SlowTcp(small_socket(server.sockets[0].getsockname()[1]))
    slow.reader, slow.writer = await asyncio.open_connection(sock=slow.plug)
    async with asyncio.timeout(PATIENCE_S):
        await served.wait()
    await slow.read_until(lambda: {"last": True} in slow.heard and slow.heard[-1] != {"last": True})
    times = [message["params"]["time"] for message in slow.heard if "params" in message and message["params"]["online"]]
    assert times == sorted(set(times))
    assert times[-1] == told - 1
    assert len(times) < told / 2  # what the kernel's buffers took, and the last
    await slow.close()
    server.close()
