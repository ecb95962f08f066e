"""A login that ends while its connection lives: that connection is nobody, is asked nothing more, and is closed."""

from __future__ import annotations

import asyncio
import json
import socket
from typing import Any

import pytest
from acp.router import MessageRouter

from backend import tokens
from backend.agent.acp.connection import ClientConnection
from backend.chat.link import RefusedError
from backend.identity import Role
from tests.agent.conftest import Opener, far
from tests.processes import PATIENCE_S, Client, Robot, eventually, trusted


async def test_a_revoked_connection_is_closed_and_others_stay(robot: Robot, connect: Opener) -> None:
    ana = await connect(robot.token("Ana", Role.OPERATOR), answer=None)
    ben = await connect(robot.token("Ben", Role.OPERATOR), answer=None)
    tokens.revoke(robot.data, "Ana")
    async with asyncio.timeout(PATIENCE_S):
        await ana.link.closed
    await ben.new()
    assert not ben.link.closed.done()


async def test_a_token_in_initialize_is_watched_like_one_in_authenticate(robot: Robot) -> None:
    reader, writer = await asyncio.open_connection("127.0.0.1", robot.agent_port)
    params = {"protocolVersion": 1, "_meta": {"robot-acp/token": robot.token("Iris", Role.OPERATOR)}}
    writer.write(json.dumps({"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": params}).encode() + b"\n")
    async with asyncio.timeout(PATIENCE_S):
        assert b'"Iris"' in await reader.readline()
        tokens.revoke(robot.data, "Iris")
        assert await reader.read() == b""
    writer.close()


async def test_a_revoked_token_authenticates_nobody_from_that_moment_on(robot: Robot, connect: Opener) -> None:
    token = robot.token("Rita", Role.SUPERVISOR)
    tokens.revoke(robot.data, "Rita")
    with pytest.raises(RefusedError, match="was revoked"):
        await connect(token)


async def test_a_connection_whose_token_expires_is_closed(robot: Robot, connect: Opener) -> None:
    client = await connect(robot.token("Exa", Role.OPERATOR, 8))
    await client.new()
    async with asyncio.timeout(PATIENCE_S):
        await client.link.closed


async def test_the_questions_of_a_revoked_connection_are_withdrawn_and_left_to_the_others(tmp_path: Any) -> None:
    robot = Robot(tmp_path)
    address = f"tcp://127.0.0.1:{robot.agent_port}"

    async def joined(name: str) -> Client:
        client = await Client.open(address, answer=None)
        login = {"methodId": "token", "_meta": {"robot-acp/token": robot.token(name, Role.SUPERVISOR)}}
        await client.link.request("authenticate", login)
        return client

    with (
        robot.running("robot", "--time-scale", "20", port=robot.robot_port),
        robot.running("agent", port=robot.agent_port),
    ):
        ana, ben = await joined("Ana"), await joined("Ben")
        await ana.new()
        await ben.load(ana.session)
        turn = ana.later(ana.prompt("say good morning"))
        await eventually(lambda: ana.questions and ben.questions, "both to be asked")

        tokens.revoke(robot.data, "Ana")
        async with asyncio.timeout(PATIENCE_S):
            await ana.link.closed
        await asyncio.gather(turn, return_exceptions=True)
        withdrawn = [m["params"]["requestId"] for m in ana.heard if m["method"] == "$/cancel_request"]
        assert withdrawn == [ana.questions[0]["id"]]
        assert not [m for m in ben.heard if m["method"] == "$/cancel_request"]

        await ben.decide("reject_once")
        ended = await eventually(
            lambda: [u for u in ben.of("tool_call_update") if "robot-acp/decision" in u.get("_meta", {})],
            "the decision",
        )
        assert ended[0]["_meta"]["robot-acp/decision"]["by"] == "Ben"
        for client in (ana, ben):
            await client.close()


async def test_a_revoked_connection_that_reads_nothing_is_cut_off() -> None:
    ended = asyncio.Event()

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        connection = ClientConnection(reader, writer, trusted=trusted, max_outbox_bytes=64 * 1024 * 1024)
        serving = asyncio.create_task(connection.serve(MessageRouter()))
        connection.deliver(b"x" * 32 * 1024 * 1024)  # more than the sockets on the way hold
        await connection.dismiss()
        assert connection.identity is None
        await serving  # it ends by itself: the socket is gone
        ended.set()

    server = await asyncio.start_server(accept, "127.0.0.1", 0)
    with socket.create_connection(server.sockets[0].getsockname()):
        async with asyncio.timeout(PATIENCE_S):
            await ended.wait()
    server.close()


async def test_what_a_visitor_began_ends_with_the_login(robot: Robot, connect: Opener) -> None:
    """A logout ends the login in this process before the page could cancel."""
    token = robot.token("Kiosk", Role.VISITOR)
    visitor, staff = await connect(token), await connect()
    await visitor.new()
    async with robot.watched() as watched:
        visitor.later(visitor.prompt(far(watched)))
        await watched.until(lambda: watched.speed > 0.1, "the robot to drive")
        tokens.revoke(robot.data, "Kiosk")
        await watched.until(lambda: watched.speed == 0 and not watched.state.motion, "the robot to halt")
        assert watched.state.stop is None
    await staff.load(visitor.session)
    await eventually(lambda: staff.of("session_info_update")[-1].get("_meta"), "the end of the turn")
    assert staff.of("session_info_update")[-1]["_meta"]["robot-acp/turn"]["stopReason"] == "cancelled"
