"""An ACP client that records and judges every frame in both directions.

It answers the agent's questions as the test says. It never repairs or hides what is wrong: whoever uses it asserts on
`violations` at the end.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from typing import Any

from tests.conformance.channels import Channel, open_channel
from tests.conformance.schema import Frame, Judge, Sender
from tests.processes import PATIENCE_S, Robot, eventually

EVERYTHING = {
    "fs": {"readTextFile": False, "writeTextFile": True},
    "terminal": True,
    "elicitation": {"form": {}},
    "_meta": {"robot-acp/telemetry": {"rate": 5}, "robot-acp/people": True},
}
"""What this client says that it can."""


LONG = ", then ".join(["go to lab 2.3.9", "go to the dock"] * 4)
"""A prompt whose turn moves the robot for longer than anything takes that is to happen meanwhile."""


class Refused(Exception):
    """The agent answered with an error."""

    def __init__(self, error: dict[str, Any]) -> None:
        super().__init__(error["message"])
        self.code = error["code"]
        self.message = error["message"]


Answer = Callable[[dict[str, Any]], dict[str, Any] | None]


def choose(option: str) -> Answer:
    """Answers a permission question with an option."""
    return lambda params: {"outcome": {"outcome": "selected", "optionId": option}}


@dataclass
class RecordedClient:
    """One connection. `answers` are the client's methods; one that returns None leaves the question open."""

    channel: Channel
    transport: str
    judge: Judge = field(default_factory=Judge)
    log: list[tuple[Sender, Frame]] = field(default_factory=list)
    forgotten: list[tuple[Sender, Frame]] = field(default_factory=list)
    answers: dict[str, Answer] = field(default_factory=dict)
    session: str = ""
    _count: int = 0
    _waiting: dict[int, asyncio.Future[Frame]] = field(default_factory=dict)
    _reader: asyncio.Task[None] | None = None
    _tasks: set[asyncio.Task[Any]] = field(default_factory=set)

    @classmethod
    @contextlib.asynccontextmanager
    async def open(
        cls, robot: Robot, transport: str, capabilities: dict[str, Any] | None = None
    ) -> AsyncIterator[RecordedClient]:
        """A client that has said hello."""
        client = cls(await open_channel(robot, transport), transport)
        client._reader = asyncio.create_task(client._read(), name="reader")
        try:
            await client.hello(EVERYTHING if capabilities is None else capabilities)
            yield client
        finally:
            await client.channel.close()
            await client._reader

    async def hello(self, capabilities: dict[str, Any] = EVERYTHING) -> dict[str, Any]:
        who = {"name": "conformance", "title": "Conformance suite", "version": "1"}
        hello = {"protocolVersion": 1, "clientCapabilities": capabilities, "clientInfo": who}
        return await self.request("initialize", hello)

    @property
    def violations(self) -> list[str]:
        """What is wrong with the frames so far."""
        return self.judge.violations

    def later(self, work: Any) -> asyncio.Task[Any]:
        """Run something beside the test."""
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    async def request(self, method: str, params: dict[str, Any]) -> dict[str, Any]:
        """Ask the agent. Raises `Refused`."""
        self._count += 1
        request_id = self._count
        answer = self._waiting[request_id] = asyncio.get_running_loop().create_future()
        await self._send({"id": request_id, "method": method, "params": params})
        async with asyncio.timeout(PATIENCE_S):
            frame = await answer
        if "error" in frame:
            raise Refused(frame["error"])
        return dict(frame["result"] or {})

    async def notify(self, method: str, params: dict[str, Any]) -> None:
        """Tell the agent."""
        await self._send({"method": method, "params": params})

    async def respond(self, request_id: Any, result: dict[str, Any]) -> None:
        """Answer a question of the agent."""
        await self._send({"id": request_id, "result": result})

    async def _send(self, message: Frame) -> None:
        frame = {"jsonrpc": "2.0"} | message
        self._record("client", frame)
        await self.channel.send(json.dumps(frame).encode())

    def _record(self, sender: Sender, frame: Frame) -> None:
        self.judge.see(sender, frame)
        self.log.append((sender, frame))

    async def _read(self) -> None:
        while (message := await self.channel.receive()) is not None:
            frame = json.loads(message)
            self._record("agent", frame)
            if "method" in frame:
                await self._take(frame)
            elif (waiting := self._waiting.pop(frame["id"], None)) and not waiting.done():
                waiting.set_result(frame)
        for waiting in self._waiting.values():
            waiting.set_exception(ConnectionError("the agent has closed the connection"))

    async def _take(self, frame: Frame) -> None:
        if "id" not in frame:
            return
        if frame["method"] not in self.answers:
            error = {"code": -32601, "message": "This client does not do that."}
            await self._send({"id": frame["id"], "error": error})
        elif (result := self.answers[frame["method"]](frame["params"])) is not None:
            await self.respond(frame["id"], result)

    # What was heard.

    def forget(self) -> None:
        """Begin to listen anew."""
        self.forgotten += self.log
        self.log.clear()

    def heard(self, method: str) -> list[Frame]:
        """Requests and notifications of the agent."""
        return [frame for sender, frame in self.log if sender == "agent" and frame.get("method") == method]

    async def hear(self, method: str, count: int = 1) -> list[Frame]:
        """Wait until the agent has sent so many."""
        await eventually(lambda: len(self.heard(method)) >= count, f"{count} × {method}")
        return self.heard(method)

    @property
    def events(self) -> list[tuple[int | None, dict[str, Any]]]:
        """The updates of the session, with their numbers."""
        told = [f["params"] for f in self.heard("session/update") if f["params"]["sessionId"] == self.session]
        return [((params.get("_meta") or {}).get("robot-acp/seq"), params["update"]) for params in told]

    def updates(self, kind: str) -> list[dict[str, Any]]:
        """The updates of the session of one kind."""
        return [update for _, update in self.events if update["sessionUpdate"] == kind]

    @property
    def numbers(self) -> list[int]:
        """The numbers of the events of the session."""
        return [number for number, _ in self.events if number is not None]

    @property
    def said(self) -> str:
        """What the robot answered in this session."""
        return "".join(update["content"]["text"] for update in self.updates("agent_message_chunk"))

    # What is asked in most cases.

    async def new(self) -> dict[str, Any]:
        """Begin a session, and be in it."""
        answer = await self.request("session/new", {"cwd": "/tmp", "mcpServers": []})  # noqa: S108 - a name, no file
        self.session = answer["sessionId"]
        return answer

    async def of_session(self, method: str, **params: Any) -> dict[str, Any]:
        """Ask something about the session that one is in."""
        return await self.request(method, {"sessionId": self.session} | params)

    async def open_again(self, method: str, meta: dict[str, Any] | None = None) -> dict[str, Any]:
        """`session/load`, `session/resume` or `session/fork`."""
        extra = {"_meta": meta} if meta is not None else {}
        return await self.of_session(method, cwd="/", mcpServers=[], **extra)

    async def prompt(self, *blocks: str | dict[str, Any]) -> str:
        """Run a turn, and return its stop reason."""
        prompt = [{"type": "text", "text": block} if isinstance(block, str) else block for block in blocks]
        return str((await self.of_session("session/prompt", prompt=prompt))["stopReason"])
