"""Before the login a connection of the agent gets little: short messages, little time, and its place only while there
is room. A client that logs in at once always gets in."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager

import pytest

from backend.identity import Role
from tests.processes import PATIENCE_S, Robot

ROOM = 8
LIMITS = {
    "ROBOT_ACP_AGENT__TRUST_LOOPBACK": "false",
    "ROBOT_ACP_AGENT__REQUESTS__MAX_BEFORE_LOGIN": str(ROOM),
}
HURRY = LIMITS | {"ROBOT_ACP_AGENT__REQUESTS__INITIALIZE_TIMEOUT": "0.5"}

Dialled = tuple[asyncio.StreamReader, asyncio.StreamWriter]


@pytest.fixture(scope="module")
def strict(robot: Robot) -> Iterator[Robot]:
    """An agent that keeps eight connections before their login."""
    other = robot.with_another_agent(LIMITS)
    with other.running("agent", port=other.agent_port):
        yield other


@pytest.fixture(scope="module")
def hurried(robot: Robot) -> Iterator[Robot]:
    """An agent that waits for `initialize` half a second."""
    other = robot.with_another_agent(HURRY)
    with other.running("agent", port=other.agent_port):
        yield other


@asynccontextmanager
async def dialled(robot: Robot, count: int = 1) -> AsyncIterator[list[Dialled]]:
    pairs = [await asyncio.open_connection("127.0.0.1", robot.agent_port) for _ in range(count)]
    try:
        yield pairs
    finally:
        for _, writer in pairs:
            writer.close()


async def initialize(pair: Dialled, token: str | None = None) -> dict[str, object]:
    reader, writer = pair
    params: dict[str, object] = {"protocolVersion": 1} | ({"_meta": {"robot-acp/token": token}} if token else {})
    writer.write(json.dumps({"jsonrpc": "2.0", "id": 0, "method": "initialize", "params": params}).encode() + b"\n")
    async with asyncio.timeout(PATIENCE_S):
        return dict(json.loads(await reader.readline()))


async def ends(reader: asyncio.StreamReader) -> None:
    """Wait until the other side has closed, whatever it sent before."""
    async with asyncio.timeout(PATIENCE_S):
        try:
            while await reader.read(65536):
                pass
        except ConnectionError:
            pass


async def test_whoever_stays_silent_is_cut_off(hurried: Robot) -> None:
    async with dialled(hurried, 2) as [(silent, _), (slow, writer)]:
        writer.write(b'{"jsonrpc":"2.0","id":0,"method":"initi')
        await ends(silent)
        await ends(slow)


async def test_one_who_has_initialized_in_time_stays(hurried: Robot) -> None:
    async with dialled(hurried, 2) as [pair, (silent, _)]:
        await initialize(pair, hurried.token("Ana", Role.VIEWER))
        await ends(silent)
        pair[1].write(b'{"jsonrpc":"2.0","id":1,"method":"session/list","params":{}}\n')
        async with asyncio.timeout(PATIENCE_S):
            assert json.loads(await pair[0].readline())["id"] == 1


async def test_a_first_message_without_an_end_is_cut_off(strict: Robot) -> None:
    async with dialled(strict) as [(reader, writer)]:
        sent = 0
        try:
            while sent < 15_000_000:
                writer.write(b"x" * 65536)
                sent += 65536
                await writer.drain()
        except ConnectionError:
            pass
        await ends(reader)


async def test_a_message_before_the_login_is_short(strict: Robot) -> None:
    async with dialled(strict) as [pair]:
        await initialize(pair)
        pair[1].write(b'{"jsonrpc":"2.0","id":1,"method":"authenticate","params":{"x":"' + b"a" * 70_000 + b'"}}\n')
        async with asyncio.timeout(PATIENCE_S):
            assert "larger than 65536 bytes" in json.loads(await pair[0].readline())["error"]["message"]


@pytest.mark.parametrize(
    ("role", "outcome"), [(Role.OPERATOR, "result"), (Role.VISITOR, "error"), (Role.VIEWER, "error")]
)
async def test_after_the_login_those_who_may_approve_send_long_ones(strict: Robot, role: Role, outcome: str) -> None:
    async with dialled(strict) as [pair]:
        await initialize(pair, strict.token("Ana", role))
        pair[1].write(b'{"jsonrpc":"2.0","id":1,"method":"session/list","params":{"x":"' + b"a" * 1_700_000 + b'"}}\n')
        async with asyncio.timeout(PATIENCE_S):
            assert outcome in json.loads(await pair[0].readline())


async def test_the_oldest_stranger_makes_room_and_everybody_gets_in(strict: Robot) -> None:
    async with dialled(strict) as [member]:
        await initialize(member, strict.token("Ana", Role.VIEWER))
        async with dialled(strict, ROOM) as strangers, dialled(strict) as [new]:
            assert "result" in await initialize(new, strict.token("Ben", Role.VIEWER))
            await ends(strangers[0][0])
            assert "result" in await initialize(strangers[-1])  # the others are still there
            member[1].write(b'{"jsonrpc":"2.0","id":1,"method":"session/list","params":{}}\n')
            async with asyncio.timeout(PATIENCE_S):
                assert "result" in json.loads(await member[0].readline())


async def test_one_who_logs_out_counts_as_a_stranger_again(strict: Robot) -> None:
    async with dialled(strict) as [member]:
        await initialize(member, strict.token("Ana", Role.VIEWER))
        member[1].write(b'{"jsonrpc":"2.0","id":1,"method":"logout","params":{}}\n')
        await member[0].readline()
        async with dialled(strict, ROOM):
            await ends(member[0])


async def test_those_who_left_take_no_room(strict: Robot) -> None:
    async with dialled(strict) as [(reader, writer)]:
        for _ in range(3 * ROOM):
            async with dialled(strict) as [(gone, left)]:
                left.write(b"GET / HTTP/1.1\r\n")
                await ends(gone)
        assert "result" in await initialize((reader, writer))
