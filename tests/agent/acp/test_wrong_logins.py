"""Wrong tokens at the agent: many are told to wait, in `initialize` and `authenticate`; a right token never is."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from typing import Any

import pytest

from backend import wire
from backend.chat.link import RefusedError
from backend.identity import Role
from tests.processes import PATIENCE_S, Client, Robot

MOST = 4


@pytest.fixture(scope="module")
def strict(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """An agent without a robot that takes few wrong tokens, and trusts nobody without one."""
    environment = {
        "ROBOT_ACP_AGENT__REQUESTS__WRONG_LOGINS": str(MOST),
        "ROBOT_ACP_AGENT__TRUST_LOOPBACK": "false",
    }
    robot = Robot(tmp_path_factory.mktemp("data"), environment)
    robot.token("Ana", Role.OPERATOR)
    with robot.running("agent", port=robot.agent_port):
        yield robot


async def initialize(robot: Robot, token: str) -> dict[str, Any]:
    """The answer to `initialize` with this token, on a connection of its own."""
    reader, writer = await asyncio.open_connection("127.0.0.1", robot.agent_port)
    params = {"protocolVersion": 1, "_meta": {"robot-acp/token": token}}
    writer.write(json.dumps({"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": params}).encode() + b"\n")
    try:
        async with asyncio.timeout(PATIENCE_S):
            return dict(json.loads(await reader.readline()))
    finally:
        writer.close()


async def test_many_are_told_to_wait_and_a_right_one_gets_in(strict: Robot) -> None:
    codes = [(await initialize(strict, f"a.b.{number}"))["error"]["code"] for number in range(MOST)]
    assert codes == [wire.AUTH_REQUIRED] * MOST
    error = (await initialize(strict, "a.b.c"))["error"]
    assert error["code"] == wire.LIMIT_EXCEEDED
    seconds = error["data"]["retryAfter"]
    assert error["message"] == f"Too many wrong logins from this address. Try again in {seconds} s."
    assert "result" in await initialize(strict, strict.token("Ana", Role.OPERATOR))

    client = await Client.open(f"tcp://127.0.0.1:{strict.agent_port}")

    async def authenticate(token: str) -> None:
        await client.link.request("authenticate", {"methodId": "token", "_meta": {"robot-acp/token": token}})

    for _ in range(2 * MOST):  # one may have been gained meanwhile
        with pytest.raises(RefusedError, match=r"not valid|Too many wrong logins") as refusal:
            await authenticate("a.b.c")
    assert "Too many wrong logins" in str(refusal.value)
    await authenticate(strict.token("Ana", Role.OPERATOR))
    await client.new()
    await client.close()
