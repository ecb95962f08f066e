"""How messages reach their handlers and answers come back: order, cancelling, leaving, errors. Streams are real."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
from collections.abc import AsyncIterator
from typing import Any

import pytest
from acp.exceptions import RequestError
from acp.router import MessageRouter

from backend.agent.acp.connection import ClientConnection
from backend.agent.acp.dispatch import AnswerThen
from tests.processes import PATIENCE_S, eventually, trusted

HELLO = {"jsonrpc": "2.0", "id": 0, "method": "initialize", "params": {"protocolVersion": 1}}


def request(request_id: int | str, method: str) -> dict[str, Any]:
    return {"jsonrpc": "2.0", "id": request_id, "method": method, "params": {}}


def notification(method: str, **params: Any) -> dict[str, Any]:
    return {"jsonrpc": "2.0", "method": method, "params": params}


class Served:
    """A connection whose handlers are the test's, and its client. `begun` and `ended` name handlers, in order."""

    def __init__(self, client: socket.socket) -> None:
        self.begun: list[str] = []
        self.ended: list[str] = []
        self.cancelled: list[str] = []
        self.may_end = asyncio.Event()
        self.router = MessageRouter()
        self.router.handle_extension_request(self.handle)
        self.router.handle_extension_notification(self.handle)
        self.client = client

    async def handle(self, name: str, _: dict[str, Any]) -> object:
        self.begun.append(name)
        try:
            match name:
                case "wait":
                    await self.may_end.wait()
                case "then":
                    await asyncio.sleep(0)
                    return AnswerThen({"first": True}, lambda: self.connection.deliver(b'{"behind":true}\n'))
                case "fail":
                    raise ValueError("SECRET")
                case "refuse":
                    raise RequestError(-32001, "No.")
        except asyncio.CancelledError:
            self.cancelled.append(name)
            raise
        self.ended.append(name)
        return {}

    async def start(self, ours: socket.socket) -> None:
        reader, writer = await asyncio.open_connection(sock=ours)
        self.connection = ClientConnection(reader, writer, trusted=trusted, max_outbox_bytes=2**20)
        self.serving = asyncio.create_task(self.connection.serve(self.router))
        self.reader, self.writer = await asyncio.open_connection(sock=self.client)
        self.send(HELLO)
        assert (await self.receive())["id"] == 0

    def send(self, *messages: dict[str, Any]) -> None:
        self.writer.write(b"".join(json.dumps(message).encode() + b"\n" for message in messages))

    async def receive(self) -> dict[str, Any]:
        async with asyncio.timeout(PATIENCE_S):
            return dict(json.loads(await self.reader.readline()))

    async def leave(self) -> None:
        self.writer.close()


@contextlib.asynccontextmanager
async def served() -> AsyncIterator[Served]:
    ours, theirs = socket.socketpair()
    there = Served(theirs)
    await there.start(ours)
    yield there
    there.may_end.set()
    await there.leave()
    async with asyncio.timeout(PATIENCE_S):
        await there.serving


async def test_handlers_begin_in_the_order_of_their_messages() -> None:
    async with served() as there:
        there.send(request(1, "_one"), notification("_two"), request(3, "_wait"), notification("_four"))
        await eventually(lambda: len(there.begun) == 4, "the handlers")
        assert there.begun == ["one", "two", "wait", "four"]


async def test_what_follows_an_answer_is_right_behind_it() -> None:
    async with served() as there:
        there.send(request(1, "_then"))
        assert await there.receive() == {"jsonrpc": "2.0", "id": 1, "result": {"first": True}}
        assert await there.receive() == {"behind": True}


async def test_a_cancelled_request_is_answered_and_others_run_on() -> None:
    async with served() as there:
        there.send(request("a", "_wait"), request("b", "_wait"), notification("$/cancel_request", requestId="a"))
        answer = await there.receive()
        assert (answer["id"], answer["error"]["code"]) == ("a", -32800)
        assert there.cancelled == ["wait"]
        there.may_end.set()
        assert (await there.receive())["id"] == "b"


@pytest.mark.parametrize("request_id", ["gone", None, True, [1], {}, 1.5])
async def test_cancelling_what_does_not_run_changes_nothing(request_id: object) -> None:
    async with served() as there:
        there.send(notification("$/cancel_request", requestId=request_id), request(1, "_one"))
        assert (await there.receive())["result"] == {}


async def test_leaving_cancels_requests_and_lets_notifications_end() -> None:
    async with served() as there:
        there.send(request(1, "_wait"), request(1, "_wait"), notification("_wait"))  # ids may be given twice
        await there.leave()
        await eventually(lambda: len(there.cancelled) == 2, "the requests to be cancelled")
        assert there.begun == ["wait"] * 3
        there.may_end.set()
        async with asyncio.timeout(PATIENCE_S):
            await there.serving
        assert there.ended == ["wait"]


async def test_a_question_to_one_who_has_left_fails() -> None:
    async with served() as there:
        question = asyncio.create_task(there.connection.request("fs/write_text_file", {}))
        assert (await there.receive())["method"] == "fs/write_text_file"
        await there.leave()
        with pytest.raises(ConnectionError):
            await question
        with pytest.raises(ConnectionError):
            await there.connection.request("fs/write_text_file", {})


async def test_an_unexpected_error_is_told_by_a_reference_alone(caplog: pytest.LogCaptureFixture) -> None:
    async with served() as there:
        there.send(notification("_fail"), notification("_refuse"), notification("_none"), request(1, "_fail"))
        answer = await there.receive()
        assert (answer["id"], answer["error"]["code"]) == (1, -32603)
        assert "SECRET" not in json.dumps(answer)
        reference = answer["error"]["message"].rstrip(".").split()[-1]
        assert reference in caplog.text
        there.send(request(2, "_refuse"))
        assert (await there.receive())["error"] == {"code": -32001, "message": "No.", "data": None}
