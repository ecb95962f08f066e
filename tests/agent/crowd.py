"""People at one real robot whose agent can be killed: who is there, what each was shown, and what has to be true of it.

For `test_interleavings.py`. Nothing here takes the agent's word for what can be seen elsewhere: the log is read from
the database, and whether the robot moves from the robot itself.
"""

from __future__ import annotations

import asyncio
import signal
import socket
import struct
import subprocess
import sys
import time
from collections import Counter, deque
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from backend.agent.sessions.store import Store
from backend.identity import Role
from tests.processes import PATIENCE_S, Client, Robot, Watched, end, eventually, listens

TIME_SCALE = "80"
AWAY_S = 0.5
"""After so long without anybody who may operate, the robot halts."""
ANSWER_S = 1.0
"""After so long a question that nobody answers is a refusal."""
SOON_S = PATIENCE_S
"""Far more than anything takes that has to happen at once, on a machine that does other work, too."""

A_WHILE = 10
"""So many of the robot's states, of which fifty come in a second."""
PRELOADED_AGENT = """
import asyncio, sys
from backend import cli
from backend.agent import server
from backend.agent.turns import model, providers
asyncio.run(providers.ready(model.OFFLINE_MODEL))
if sys.stdin.readline():
    sys.exit(cli.main(["agent"]))
"""
"""`robot-acp agent` that has imported its modules, which takes seconds, and begins with the first line of its stdin:
so that a hundred interleavings can hold many deaths. It has read nothing before it begins."""

Update = dict[str, Any]


async def soon(condition: Callable[[], Awaitable[bool]], what: str, seconds: float = SOON_S) -> None:
    """Like `eventually`, for a condition that has to be awaited."""
    deadline = time.monotonic() + seconds
    while not await condition():
        assert time.monotonic() < deadline, f"waited {seconds:g} s for {what}"
        await asyncio.sleep(0.01)


@dataclass
class Log:
    """The events of one session as the database has them; event n is `updates[n - 1]`."""

    store: Store
    session: str
    updates: list[Update] = field(default_factory=list)
    times: list[float] = field(default_factory=list)

    async def catch_up(self) -> None:
        """Read what has come."""
        async for event in self.store.events(self.session, after=len(self.updates)):
            assert event.seq == len(self.updates) + 1, f"the log lacks the event before {event.seq}"
            self.updates.append(event.update)
            self.times.append(event.time)

    async def reread(self) -> None:
        """Read all of it again: what was there is there, and as it was."""
        before = list(self.updates)
        self.updates.clear()
        self.times.clear()
        await self.catch_up()
        assert self.updates[: len(before)] == before

    @property
    def under_way(self) -> str | None:
        """The turn that has begun and not ended. Turns follow each other, and end after every call that they made."""
        running: str | None = None
        calls: set[str] = set()
        for number, update in enumerate(self.updates, 1):
            turn = (update.get("_meta") or {}).get("robot-acp/turn") or {}
            if turn.get("state") == "running":
                assert running in (None, turn["id"]), f"event {number}: two turns at once"
                running = turn["id"]
            elif turn.get("state") == "ended":
                assert running == turn["id"], f"event {number}: the end of a turn that does not run"
                assert not calls, f"event {number}: the turn ends before its calls {calls}"
                running = None
            elif update["sessionUpdate"] == "tool_call":
                calls.add(update["toolCallId"])
            elif update.get("status") in ("completed", "failed"):
                assert update["toolCallId"] in calls, f"event {number}: the end of a call that is not open"
                calls.remove(update["toolCallId"])
        return running

    def said(self, text: str) -> list[tuple[float, float]]:
        """When the agent decided to say it: not before the event before, not after the saying. Unix seconds."""
        return [
            (self.times[number - 1], self.times[number])
            for number, update in enumerate(self.updates)
            if update["sessionUpdate"] == "agent_message_chunk" and text in update["content"]["text"]
        ]


@dataclass
class View:
    """What one connection hears of one session."""

    by: str
    starts: list[int | None] = field(default_factory=list)
    """The first event that each attaching asked for, in the order of asking; None: whatever comes next."""
    replaying: int = 0
    """Attachings with a replay that have not been answered."""
    prompted: dict[str, bool] = field(default_factory=dict)
    """The prompts that this connection sent -> whether a replay may bring them back. Live, they never come back."""

    def begin(self, start: int | None) -> None:
        """An attaching is asked for."""
        self.starts.append(start)
        if start is not None:
            self.replaying += 1
            self.prompted = dict.fromkeys(self.prompted, True)

    def follows(self, log: Log, heard: list[tuple[int, Update]]) -> None:
        """Fail unless this is the log, without gap, double or change of order, from each start on."""
        starts = deque(self.starts)
        last: int | None = None
        for number, update in heard:
            assert number <= len(log.updates), f"event {number} was shown to {self.by} and is not in the log"
            assert update == log.updates[number - 1], f"{self.by} was shown another event {number}"
            own = self._own(update)
            assert own is None or self.prompted[own], f"{self.by} was shown their own prompt {own!r}"
            while last is None or not self._silent(log, last + 1, number):
                assert starts, f"{self.by} was shown event {number} after {last}; asked for: {self.starts}"
                start = starts.popleft()
                last = number - 1 if start is None else start - 1
            last = number

    def _own(self, update: Update) -> str | None:
        if update["sessionUpdate"] != "user_message_chunk" or update["_meta"]["robot-acp/by"] != self.by:
            return None
        text = str(update["content"]["text"])
        return text if text in self.prompted else None

    def _silent(self, log: Log, first: int, upto: int) -> bool:
        """Whether nothing from `first` on and before `upto` had to be shown."""
        return first <= upto and all(self._own(update) is not None for update in log.updates[first - 1 : upto - 1])

    def complete(self, log: Log, heard: list[tuple[int, Update]]) -> bool:
        """Whether the last event of the log has been shown."""
        last = heard[-1][0] if heard else None
        if last is None:
            start = next((s for s in reversed(self.starts) if s is not None), None)
            return start is None or self._silent(log, start, len(log.updates) + 1)
        return self._silent(log, last + 1, len(log.updates) + 1)


@dataclass(eq=False)
class Asked:
    """A prompt that somebody sent over a connection."""

    seat: Seat
    session: str
    text: str
    request_id: int
    answer: asyncio.Task[str]


@dataclass(eq=False)
class Seat:
    """One connection of one person."""

    who: Person
    client: Client
    views: dict[str, View] = field(default_factory=dict)
    attached: set[str] = field(default_factory=set)
    """The sessions that were asked for."""
    there: bool = False
    """Whether the agent has said that one of them is."""
    answered: set[Any] = field(default_factory=set)
    """The questions that were answered, in whatever way."""

    @property
    def alive(self) -> bool:
        """Whether the connection stands, as far as this end knows."""
        return not self.client.link.closed.done()

    def view(self, session: str) -> View:
        """What is heard of a session here."""
        return self.views.setdefault(session, View(self.who.name))

    def heard(self, session: str) -> list[tuple[int, Update]]:
        """The events of a session with their numbers, in the order they came."""
        return [
            (event["_meta"]["robot-acp/seq"], event["update"])
            for event in self.client.events
            if event["sessionId"] == session
        ]

    @property
    def open_questions(self) -> list[dict[str, Any]]:
        """Those that were neither answered nor withdrawn."""
        withdrawn = {m["params"]["requestId"] for m in self.client.heard if m["method"] == "$/cancel_request"}
        return [q for q in self.client.questions if q["id"] not in self.answered | withdrawn]

    async def leave(self, *, abruptly: bool) -> None:
        """Disconnect; abruptly: with a reset instead of a word, as a computer that is switched off."""
        self.attached.clear()
        self.there = False
        if abruptly:
            writer = self.client.link._stream._writer
            writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            writer.transport.abort()
        await self.client.close()


@dataclass(eq=False)
class Person:
    """Somebody with a login, connected or not."""

    name: str
    role: Role
    seat: Seat | None = None
    past: list[Seat] = field(default_factory=list)
    known: dict[str, int] = field(default_factory=dict)
    """Session -> the last event that this person was shown."""

    @property
    def operates(self) -> bool:
        """Whether it counts as somebody being there."""
        return self.role in (Role.OPERATOR, Role.SUPERVISOR)

    def remember(self) -> None:
        """Note what has been shown so far."""
        for seat in [*self.past, self.seat]:
            for session in seat.views if seat else ():
                for number, _ in seat.heard(session):
                    self.known[session] = max(number, self.known.get(session, 0))


class Site:
    """A robot server, an agent that can be killed, and somebody neutral who looks at both."""

    robot: Robot
    agent: subprocess.Popen[str]
    watched: Watched
    observer: Client
    """A supervisor who is attached to nothing, and hears the agent's `_robot/telemetry`."""
    store: Store

    def __init__(self, data: Path) -> None:
        settings = {
            "ROBOT_ACP_AGENT__UNATTENDED_AFTER": str(AWAY_S),
            "ROBOT_ACP_AGENT__PERMISSION_TIMEOUT": str(ANSWER_S),
            "ROBOT_ACP_ROBOT__LIMITS__BATTERY_FLOOR": "0",  # hours pass on the robot's clock
            "ROBOT_ACP_LOG_LEVEL": "error",
        }
        self.robot = Robot(data, settings)
        self.tokens: dict[tuple[str, Role], str] = {}
        self.examples = 0
        self.done: Counter[str] = Counter()
        """How often each thing has really been done."""
        self.failure: BaseException | None = None
        """What went wrong first."""
        self._open = AsyncExitStack()

    async def __aenter__(self) -> Site:
        starting = self.robot.running("robot", "--time-scale", TIME_SCALE, port=self.robot.robot_port)
        self._open.enter_context(starting)
        self._next = self._preload()
        self._open.callback(lambda: end(self._next))
        await self.start_agent()
        self._open.callback(lambda: end(self.agent))
        self.watched = await self._open.enter_async_context(self.robot.watched())
        self.store = Store(f"sqlite:///{self.robot.data / 'sessions.db'}", writes=False)
        await self.store.open()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.observer.close()
        await self.store.close()
        await self._open.aclose()

    @property
    def address(self) -> str:
        """Where the agent listens."""
        return f"tcp://127.0.0.1:{self.robot.agent_port}"

    def token(self, person: Person) -> str:
        """The login of a person, made once."""
        key = (person.name, person.role)
        if key not in self.tokens:
            self.tokens[key] = self.robot.token(*key)
        return self.tokens[key]

    def _preload(self) -> subprocess.Popen[str]:
        command = [sys.executable, "-c", PRELOADED_AGENT]
        return subprocess.Popen(command, env=self.robot.variables, text=True, stdin=subprocess.PIPE)

    async def start_agent(self) -> None:
        """Start the agent on the data folder, and look at it."""
        self.agent, self._next = self._next, self._preload()
        assert self.agent.stdin
        self.agent.stdin.write("begin\n")
        self.agent.stdin.close()
        # Importing takes seconds of a whole core, and another agent may have died just before.
        await eventually(lambda: listens(self.robot.agent_port), "the agent to answer", 4 * PATIENCE_S)
        wants = {"_meta": {"robot-acp/telemetry": {"rate": 10}}}
        self.observer = await Client.open(self.address, capabilities=wants)

    async def kill_agent(self) -> None:
        """SIGKILL. Returns when the process is gone."""
        end(self.agent, signal.SIGKILL)
        await self.observer.close()

    @property
    def holder(self) -> str | None:
        """The session whose turn holds the robot, as the agent told last."""
        told = [m["params"] for m in self.observer.heard[-50:] if m["method"] == "_robot/telemetry"]
        turn = told[-1]["turn"] if told else None
        return str(turn["sessionId"]) if turn else None

    @property
    def moving(self) -> bool:
        """Whether the robot moves or is about to, as itself tells."""
        return not at_rest(self.watched.state)

    def stands(self, since: int) -> bool:
        """Whether the robot has stood for a while, later than its state number `since`: a command that was under way
        when its sender died can begin, and ends in the same moment."""
        states = self.watched.states[since:]
        return len(states) > A_WHILE and all(at_rest(state) for _, state in states[-A_WHILE:])


def at_rest(state: Any) -> bool:
    """Whether the robot stands and has no goal."""
    return state.motion is None and state.twist.linear == 0 and state.twist.angular == 0
