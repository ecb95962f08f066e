"""Starts the real commands on free ports of the loopback, waits until they answer, and ends them."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from websockets.asyncio.client import connect

from backend import identity, telemetry, tokens
from backend.chat.link import Link, open_link
from backend.identity import Role
from tests.forked import Forked

PATIENCE_S = 30.0
"""After so long a condition that is waited for has failed."""
STARTS_S = 90.0
"""The same for processes that begin: they load their libraries, several at once, beside other things."""


WORKERS = 8
_worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
_ports = itertools.cycle(random.SystemRandom().sample(range(20_000 + _worker % WORKERS, 32_000, WORKERS), 1_500))
"""Below those that a system gives to connections that go out: such a one would take the port of a server that is down
for a moment, and could even be a connection to itself. None comes twice in a run. Workers of one run share none: their
`random` begins with the same seed, and each would look for the port that the other is about to take."""


def free_port() -> int:
    while True:
        port = next(_ports)
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port


def wait_until(condition: Callable[[], Any], what: str, seconds: float = PATIENCE_S) -> Any:
    deadline = time.monotonic() + seconds
    while not (value := condition()):  # looked at once more after a stall that was longer than the patience
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {seconds:g} s for {what}")
        time.sleep(0.02)
    return value


def listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


Process = subprocess.Popen[str] | Forked
"""A command that a test started."""


@dataclass
class Robot:
    """The three addresses and the data folder of one robot, and the processes that were started for it."""

    data: Path
    environment: dict[str, str] = field(default_factory=dict)
    robot_port: int = field(default_factory=free_port)
    agent_port: int = field(default_factory=free_port)
    bridge_port: int = field(default_factory=free_port)

    @property
    def variables(self) -> dict[str, str]:
        kept = {k: v for k, v in os.environ.items() if not k.startswith("ROBOT_ACP_") and not k.endswith("_KEY")}
        return kept | {
            "ROBOT_ACP_DATA_DIR": str(self.data),
            "ROBOT_ACP_ROBOT__PORT": str(self.robot_port),
            "ROBOT_ACP_AGENT__PORT": str(self.agent_port),
            "ROBOT_ACP_BRIDGE__PORT": str(self.bridge_port),
            # A machine that stands for seconds is no client that is silent: only tests of the watchdog look at that.
            "ROBOT_ACP_ROBOT__LIMITS__CLIENT_SILENCE": "30",
            **self.environment,
        }

    @staticmethod
    def command(*arguments: str) -> list[str]:
        return [sys.executable, "-m", "backend.cli", *arguments]

    def spawn(self, *arguments: str, **streams: Any) -> Process:
        """A command in a process of its own, forked: `tests.forked` says what that saves."""
        if any("ros2" in argument for argument in arguments):
            return self.start(*arguments, **streams)  # ROS finds its libraries by what a process begins with
        return Forked(arguments, self.variables, **streams)

    def start(self, *arguments: str, **streams: Any) -> subprocess.Popen[str]:
        """A command as people start it, in a new Python: for tests of starting, ending and restarting."""
        return subprocess.Popen(self.command(*arguments), env=self.variables, text=True, **streams)

    @contextlib.contextmanager
    def running(self, *arguments: str, port: int) -> Iterator[Process]:
        process = self.spawn(*arguments)
        try:
            wait_until(lambda: listens(port), f"`robot-acp {' '.join(arguments)}` to answer", STARTS_S)
            yield process
        finally:
            end(process)

    @contextlib.contextmanager
    def at_work(self, *arguments: str, bridge: bool = True) -> Iterator[Robot]:
        """The robot server with these arguments, the agent and, if wanted, the bridge run while the context lasts."""
        with (
            self.running("robot", *arguments, port=self.robot_port),
            self.running("agent", port=self.agent_port),
            self.running("bridge", port=self.bridge_port) if bridge else contextlib.nullcontext(),
        ):
            yield self

    def with_another_agent(self, environment: dict[str, str] | None = None) -> Robot:
        """The same robot server and data folder with an agent of its own: on another port, with another database."""
        port = free_port()
        database = {"ROBOT_ACP_AGENT__DATABASE": f"sqlite:///{self.data / f'sessions-{port}.db'}"}
        kept = self.environment | database | (environment or {})
        return Robot(self.data, kept, robot_port=self.robot_port, agent_port=port)

    def token(self, name: str, role: Role, seconds: float = 3600.0) -> str:
        return token_of(self.data, name, role, seconds)

    @property
    def robot_headers(self) -> dict[str, str]:
        return {"Authorization": f"Bearer {identity.shared_secret(self.data, identity.ROBOT_TOKEN).decode()}"}

    @contextlib.asynccontextmanager
    async def watched(self) -> AsyncIterator[Watched]:
        """The robot's own telemetry, recorded while the context lasts."""
        url = f"ws://127.0.0.1:{self.robot_port}/telemetry"
        async with connect(url, additional_headers=self.robot_headers) as wire:
            await wire.send(telemetry.encode(telemetry.Subscribe(["state", "speech", "path"], rate=50.0)))
            record = Watched()

            async def read() -> None:
                async for frame in wire:
                    assert isinstance(frame, bytes)
                    record.take(telemetry.decode(frame))

            reader = asyncio.create_task(read())
            try:
                await record.until(lambda: record.states, "the robot's state")
                yield record
            finally:
                reader.cancel()
                await asyncio.gather(reader, return_exceptions=True)

    async def state(self) -> telemetry.State:
        """How it is now: telemetry that begins only now cannot be late."""
        async with self.watched() as now:
            return now.state

    async def stands(self) -> bool:
        """Whether it stands and has nothing to do."""
        now = await self.state()
        return now.motion is None and now.twist == telemetry.Twist(0.0, 0.0)


@dataclass
class Watched:
    """What the robot itself told: its states with the wall time of their arrival, and what it said."""

    states: list[tuple[float, telemetry.State]] = field(default_factory=list)
    spoken: list[str] = field(default_factory=list)
    previews: int = 0
    path: telemetry.Path | None = None

    def take(self, message: telemetry.AnyMessage) -> None:
        if isinstance(message, telemetry.State):
            self.states.append((time.monotonic(), message))
        elif isinstance(message, telemetry.Speech):
            self.spoken.append(message.text)
        elif isinstance(message, telemetry.Path):
            self.path = message
            self.previews += bool(message.preview and message.points)

    @property
    def state(self) -> telemetry.State:
        return self.states[-1][1]

    @property
    def preview(self) -> list[tuple[float, float]]:
        """The way that the robot shows without driving it; empty when it shows none."""
        return self.path.points if self.path and self.path.preview else []

    @property
    def speed(self) -> float:
        return abs(self.state.twist.linear)

    def distance_to(self, x: float, y: float) -> float:
        return float(((self.state.pose.x - x) ** 2 + (self.state.pose.y - y) ** 2) ** 0.5)

    async def until(self, condition: Callable[[], Any], what: str, seconds: float = PATIENCE_S) -> Any:
        return await eventually(condition, what, seconds)


async def eventually(condition: Callable[[], Any], what: str, seconds: float = PATIENCE_S) -> Any:
    deadline = time.monotonic() + seconds
    while not (value := condition()):  # looked at once more after a stall that was longer than the patience
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {seconds:g} s for {what}")
        await asyncio.sleep(0.005)
    return value


def end(process: Process, number: int = signal.SIGTERM) -> int:
    """End a process that a test started, and return its exit status; killed after the time limit, which fails."""
    if process.poll() is None:
        process.send_signal(number)
    try:
        return process.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait(PATIENCE_S)
        raise AssertionError("the process did not end") from None


def token_of(data: Path, name: str, role: Role, seconds: float) -> str:
    """A login token. In the tests a name has one person for each of its roles, as in lists of earlier versions."""
    key = identity.shared_secret(data, identity.SIGNING_KEY)
    with tokens._locked(data):
        known = tokens.records(data)
        theirs = [one.subject for one in known if (one.name, one.role) == (name, role)]
        record = tokens._record(name, role, seconds, theirs[-1] if theirs else f"{name}, {role.value}")
        tokens._add(data, known, record)
    return identity.issue(key, name, role, seconds, record.id, record.subject)


async def trusted() -> bool:
    """For a `ClientConnection` whose client needs no token."""
    return True


@dataclass
class Client:
    """An ACP client that keeps everything it hears, and answers permission questions with `answer`."""

    link: Link
    heard: list[dict[str, Any]] = field(default_factory=list)
    questions: list[dict[str, Any]] = field(default_factory=list)
    answer: str | None = "allow_once"
    session: str = ""
    _tasks: set[asyncio.Task[None]] = field(default_factory=set)

    @classmethod
    async def open(
        cls, address: str, token: str | None = None, capabilities: dict[str, Any] | None = None, **options: Any
    ) -> Client:
        client: Client
        link = await open_link(address, token, lambda message: client._take(message))
        client = cls(link, **options)
        await link.request("initialize", {"protocolVersion": 1, "clientCapabilities": capabilities or {}})
        return client

    def _take(self, message: dict[str, Any]) -> None:
        self.heard.append(message)
        if message["method"] == "session/request_permission":
            self.questions.append(message)
            if self.answer is not None:
                self.later(self.decide(self.answer))

    def later(self, work: Any) -> asyncio.Task[Any]:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    async def decide(self, option: str, question: int = -1) -> None:
        outcome = {"outcome": {"outcome": "selected", "optionId": option}}
        await self.link.respond(self.questions[question]["id"], outcome)

    async def new(self) -> str:
        answer = await self.link.request("session/new", {"cwd": "/", "mcpServers": []})
        self.session = answer["sessionId"]
        return self.session

    async def load(self, session: str) -> dict[str, Any]:
        self.session = session
        return await self.link.request("session/load", {"sessionId": session, "cwd": "/", "mcpServers": []})

    async def prompt(self, text: str) -> str:
        blocks = [{"type": "text", "text": text}]
        answer = await self.link.request("session/prompt", {"sessionId": self.session, "prompt": blocks})
        return str(answer["stopReason"])

    async def cancel(self) -> None:
        await self.link.notify("session/cancel", {"sessionId": self.session})

    @property
    def events(self) -> list[dict[str, Any]]:
        """The numbered events; what belongs to the connection alone, as the list of commands, has no number."""
        return [m["params"] for m in self.heard if m["method"] == "session/update" and "_meta" in m["params"]]

    @property
    def updates(self) -> list[dict[str, Any]]:
        return [event["update"] for event in self.events]

    @property
    def numbers(self) -> list[int]:
        return [event["_meta"]["robot-acp/seq"] for event in self.events]

    def of(self, kind: str) -> list[dict[str, Any]]:
        return [u for u in self.updates if u["sessionUpdate"] == kind]

    @property
    def said(self) -> str:
        return "".join(u["content"]["text"] for u in self.of("agent_message_chunk"))

    async def close(self) -> None:
        await self.link.close()
        await asyncio.gather(*self._tasks, return_exceptions=True)
