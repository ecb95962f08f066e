"""After a valid `initialize`: whatever a client sends, it gets the right error or none, the connection and the process
live, and no text of an exception reaches it.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
from collections.abc import AsyncIterator
from typing import Any

import pytest
import pytest_asyncio
from websockets.exceptions import ConnectionClosed

from backend import wire
from backend.identity import Role
from tests.conformance import hostile
from tests.conformance.channels import Channel, Frames, open_channel
from tests.conformance.hostile import Hostile
from tests.processes import PATIENCE_S, Robot

pytestmark = pytest.mark.asyncio(loop_scope="module")

FRAMES = hostile.frames()
assert len(FRAMES) >= 200
HUGE = hostile.request("session/list", {"x": "a" * 50_000_000})
LEAK = re.compile(
    r"traceback|exception|\b\w+Error\b|pydantic|sqlalchemy|sqlite|orjson|msgspec|asyncio|site-packages|backend[./]"
    r"|acp\.schema|\.py\b|<class|object at 0x|0x[0-9a-f]{6}|Input should|Field required|NoneType"
    # The names of the schema's classes, as a validator would tell them.
    r"|(?-i:ContentBlock|McpServer|[a-z]Request\b|SessionConfig|function-|tagged-union)",
    re.I,
)


class Victim:
    """A connection that has said hello, and a session in it."""

    def __init__(self, channel: Channel) -> None:
        self.channel = channel
        self.session = ""
        self._pings = 0

    async def hello(self) -> None:
        await self.channel.send(hostile.request("initialize", {"protocolVersion": 1}))
        assert "result" in await self.answer()
        await self.channel.send(hostile.request("session/new", {"cwd": "/", "mcpServers": []}))
        self.session = (await self.answer())["result"]["sessionId"]

    async def answer(self) -> dict[str, Any]:
        """The next answer; notifications are passed over."""
        async with asyncio.timeout(PATIENCE_S):
            while True:
                message = await self.channel.receive()
                assert message is not None, "the connection was closed"
                frame = dict(json.loads(message))
                assert frame["jsonrpc"] == "2.0"
                if "method" not in frame:
                    return frame

    async def provoke(self, raw: bytes, answered: bool) -> list[dict[str, Any]]:
        """Send a frame and then a ping: what came besides the answer to the ping."""
        self._pings += 1
        ping = f"ping {self._pings}"
        await self.channel.send(raw.replace(hostile.SESSION.encode(), self.session.encode()))
        # A result may be waited for only after the ping, but the ping does not wait for it.
        await self.channel.send(hostile.request("session/list", {}, ping))
        answers: list[dict[str, Any]] = []
        while len(answers) < 1 + answered:
            answers.append(await self.answer())
        (pong,) = [answer for answer in answers if answer["id"] == ping]
        assert "result" in pong
        return [answer for answer in answers if answer is not pong]


@pytest_asyncio.fixture(scope="module", loop_scope="module", params=["tcp", "bridge"])
async def victim(robot: Robot, request: pytest.FixtureRequest) -> AsyncIterator[Victim]:
    """One connection for all frames: the last of them finds it as good as the first."""
    channel = await open_channel(robot, request.param)
    victim = Victim(channel)
    await victim.hello()
    yield victim
    await channel.close()


@pytest.mark.parametrize(
    "frame", [pytest.param(frame, id=frame.name.encode("unicode_escape").decode()) for frame in FRAMES]
)
async def test_a_hostile_frame(victim: Victim, frame: Hostile) -> None:
    answers = await victim.provoke(frame.raw, frame.expected.answered)
    if not frame.expected.answered:
        return
    (answer,) = answers
    assert answer["id"] == frame.expected.id
    assert answer.get("error", {}).get("code") == frame.expected.code
    if "error" in answer:
        told = {"message": answer["error"]["message"], "data": answer["error"].get("data")}
        text = json.dumps(told, ensure_ascii=False)
        assert len(told["message"]) < 300
        assert not LEAK.search(text), text


async def test_meta_has_changed_nothing(victim: Victim) -> None:
    """After all the frames: the session still has its mode, and this is still who it was."""
    await victim.channel.send(
        hostile.request("session/load", {"sessionId": victim.session, "cwd": "/", "mcpServers": []})
    )
    loaded = (await victim.answer())["result"]
    assert loaded["modes"]["currentModeId"] == "supervised"
    await victim.channel.send(hostile.request("initialize", {"protocolVersion": 1}))
    ours = (await victim.answer())["result"]["agentCapabilities"]["_meta"]["robot-acp"]
    assert (ours["role"], ours["name"] in ("local", "Ana")) == ("supervisor", True)


@pytest.mark.parametrize("transport", ["tcp", "bridge"])
@pytest.mark.parametrize("meta", [pytest.param(meta, id=name) for name, meta in hostile.SNEAKY.items()])
async def test_meta_makes_nobody_a_supervisor(robot: Robot, transport: str, meta: Any) -> None:
    viewer = robot.token("Vic", Role.VIEWER)
    channel: Channel = await Frames.dial(robot, viewer) if transport == "bridge" else await open_channel(robot, "tcp")
    victim = Victim(channel)

    async def ask(method: str, params: dict[str, Any]) -> dict[str, Any]:
        await channel.send(hostile.request(method, params))
        return await victim.answer()

    if transport == "bridge":
        hello = await ask("initialize", {"protocolVersion": 1, "_meta": meta})
        assert hello["result"]["agentCapabilities"]["_meta"]["robot-acp"]["role"] == "viewer"
    else:
        await ask("initialize", {"protocolVersion": 1})
        assert "result" in await ask("authenticate", {"methodId": "token", "_meta": {"robot-acp/token": viewer}})
    for method, params in (("session/new", {"cwd": "/", "mcpServers": []}), ("_robot/release", {})):
        refused = await ask(method, params | {"_meta": meta})
        assert refused["error"]["code"] == wire.NOT_ALLOWED
    await channel.close()


async def test_a_frame_of_50_mb_over_tcp(robot: Robot) -> None:
    victim = Victim(await open_channel(robot, "tcp"))
    await victim.hello()
    for raw in (HUGE, b"a" * 50_000_000, b'{"a":' * 10_000_000):
        (answer,) = await victim.provoke(raw, True)
        assert (answer["id"], answer["error"]["code"]) == (None, hostile.INVALID_REQUEST)
    await victim.channel.close()


async def test_a_frame_of_50_mb_over_the_bridge_ends_that_connection_and_no_other(robot: Robot, victim: Victim) -> None:
    """As WebSocket has it: close code 1009, message too big."""
    channel = await Frames.dial(robot, robot.token("Ana", Role.SUPERVISOR))
    await Victim(channel).hello()
    with contextlib.suppress(ConnectionClosed):  # it may come before all is sent
        await channel.send(HUGE)
    async with asyncio.timeout(PATIENCE_S):
        await channel.socket.wait_closed()
    assert channel.socket.close_code == 1009
    assert await victim.provoke(b"{}", True)
