"""How much one login may ask for: a burst is refused in part, delays nobody else, and never a cancel or a stop."""

from __future__ import annotations

import asyncio
import itertools
import json
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest
from acp.exceptions import RequestError

from backend import wire
from backend.agent.acp.request_limits import LONGEST_PAUSE_S, Account, ReadingPace, RequestLimits, is_urgent
from backend.config import AgentRequests
from backend.identity import Identity, Role
from tests.agent.conftest import far
from tests.processes import PATIENCE_S, Robot, eventually

FLOOD = 20_000
LIST = '{"jsonrpc":"2.0","id":%d,"method":"session/list","params":{}}\n'


class Clock:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def account(clock: Clock | None = None, **limits: Any) -> Account:
    return RequestLimits(AgentRequests(**limits), clock or Clock()).new()


def test_beyond_the_burst_a_request_is_refused_with_the_time_to_wait() -> None:
    clock = Clock()
    mine = account(clock, per_second=0.5, burst=10)
    for _ in range(10):
        mine.charge(0)
    with pytest.raises(RequestError) as refused:
        mine.charge(0)
    assert refused.value.code == wire.LIMIT_EXCEEDED
    assert refused.value.data == {"retryAfter": 2}
    assert "Try again in 2 s." in str(refused.value)
    clock.now = 2.0
    mine.charge(0)


def test_no_more_wait_for_their_answers_than_the_limits_say() -> None:
    mine = account(pending_per_connection=4, pending_per_login=6)
    with pytest.raises(RequestError, match="wait for their answers"):
        mine.charge(4)
    mine.pending = 6
    with pytest.raises(RequestError, match="wait for their answers"):
        mine.charge(0)
    mine.pending = 5
    mine.charge(3)


async def test_one_who_sends_on_and_on_is_read_slower_and_a_large_message_counts_as_many() -> None:
    mine, pace = account(messages_per_second=1000, messages_burst=100), ReadingPace()
    for _ in range(99):
        pace.count(mine, 10)
        assert pace._pause == 0
    pace.count(mine, 16 * 1024 * 1024)
    assert pace._pause == LONGEST_PAUSE_S
    await pace.wait()
    assert pace._pause == 0


def test_all_logins_of_a_person_share_an_account_and_nobody_else_does() -> None:
    limits = RequestLimits()
    ana = limits.of(Identity("Ana", Role.VIEWER, "1"))
    assert ana is limits.of(Identity("Ana", Role.VIEWER, "2"))
    assert ana is not limits.of(Identity("Ben", Role.VIEWER, "1"))
    assert limits.of(Identity("local", Role.SUPERVISOR)) is None
    assert limits.new() is not limits.new()


def test_accounts_that_nobody_uses_are_forgotten() -> None:
    clock = Clock()
    limits = RequestLimits(clock=clock)
    busy = limits.of(Identity("Ana", Role.VIEWER, "busy"))
    assert busy is not None
    busy.pending = 1
    for number in range(5000):
        clock.now += 60
        limits.of(Identity(f"x{number}", Role.VIEWER, "a")).charge(0)  # type: ignore[union-attr]
    assert len(limits._accounts) <= 1024
    assert limits.of(Identity("Ana", Role.VIEWER, "busy")) is busy


@pytest.mark.parametrize(
    ("message", "urgent"),
    [
        ({"method": "session/cancel", "params": {"sessionId": "x"}}, True),
        ({"method": "_robot/stop", "id": 1}, True),
        ({"method": "session/prompt", "id": 1, "params": {"prompt": [{"type": "text", "text": " /STOP "}]}}, True),
        ({"method": "session/prompt", "id": 1, "params": {"prompt": [{"type": "text", "text": "stop"}]}}, False),
        ({"method": "session/prompt", "id": 1, "params": {"prompt": [{"type": "text", "text": 1}]}}, False),
        ({"method": "session/prompt", "id": 1, "params": {"prompt": ["/stop"]}}, False),
        ({"method": "session/prompt", "id": 1, "params": {"prompt": 1}}, False),
        ({"method": "session/prompt", "id": 1}, False),
        ({"method": "session/cancel", "id": 1, "params": {"sessionId": "x"}}, False),
        ({"method": "_robot/release", "id": 1}, False),
        ({"method": "_robot/stop"}, False),
    ],
)
def test_what_cancels_or_stops_is_urgent(message: dict[str, Any], urgent: bool) -> None:
    assert is_urgent(wire.check(json.dumps({"jsonrpc": "2.0"} | message).encode())) is urgent


class Line:
    """A connection to the agent as somebody, and the answers that have come, by request id."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.writer = writer
        self.answers: dict[int, dict[str, Any]] = {}
        """In the order in which they came."""
        self.answered_at: dict[int, float] = {}
        self._ids = itertools.count(1_000_000)
        self._reading = asyncio.create_task(self._read(reader))

    async def _read(self, reader: asyncio.StreamReader) -> None:
        while line := await reader.readline():
            message = json.loads(line)
            if "id" in message and "method" not in message:
                self.answers[message["id"]] = message
                self.answered_at[message["id"]] = time.monotonic()

    def flood(self, count: int) -> None:
        """Send so many requests at once, with the ids from 0 on."""
        self.writer.write("".join(LIST % number for number in range(count)).encode())

    def notify(self, method: str, count: int = 1, **params: Any) -> None:
        line = json.dumps({"jsonrpc": "2.0", "method": method, "params": params}) + "\n"
        self.writer.write(line.encode() * count)

    async def ask(self, method: str, **params: Any) -> dict[str, Any]:
        number = next(self._ids)
        message = {"jsonrpc": "2.0", "id": number, "method": method, "params": params}
        self.writer.write(json.dumps(message).encode() + b"\n")
        await eventually(lambda: number in self.answers, f"the answer to {method}")
        return self.answers[number]

    @property
    def refused(self) -> list[dict[str, Any]]:
        return [a["error"] for a in self.answers.values() if a.get("error", {}).get("code") == wire.LIMIT_EXCEEDED]

    def close(self) -> None:
        self._reading.cancel()
        self.writer.close()


@asynccontextmanager
async def line(robot: Robot, token: str) -> AsyncIterator[Line]:
    opened = Line(*await asyncio.open_connection("127.0.0.1", robot.agent_port, limit=2**24))
    try:
        meta = {"robot-acp/token": token}
        assert "result" in await opened.ask("initialize", protocolVersion=1, _meta=meta)
        yield opened
    finally:
        opened.close()


async def test_of_a_flood_each_request_is_answered_and_most_are_refused(robot: Robot) -> None:
    async with line(robot, robot.token("Vera", Role.VIEWER)) as viewer:
        viewer.flood(FLOOD)
        await eventually(lambda: len(viewer.answers) == FLOOD + 1, "all answers", 2 * PATIENCE_S)
        assert len(viewer.refused) > FLOOD // 2
        assert all(error["data"]["retryAfter"] >= 1 for error in viewer.refused)
        assert all("Try again in" in error["message"] for error in viewer.refused)
        assert len(viewer.answers) - len(viewer.refused) > 32  # it was served, too


async def test_a_flood_delays_nobody_else(robot: Robot) -> None:
    async with (
        line(robot, robot.token("Vera", Role.VIEWER)) as viewer,
        line(robot, robot.token("Sue", Role.SUPERVISOR)) as supervisor,
    ):
        viewer.flood(FLOOD)
        await eventually(lambda: len(viewer.answers) > 1, "the first answer to the flood")
        assert "result" in await supervisor.ask("session/list")
        await eventually(lambda: len(viewer.answers) == FLOOD + 1, "all answers", 2 * PATIENCE_S)
        behind = [at for at in viewer.answered_at.values() if at > max(supervisor.answered_at.values())]
        assert len(behind) > FLOOD // 4, "the supervisor was answered behind the flood"


async def test_another_connection_of_the_person_is_refused_and_somebody_else_is_not(robot: Robot) -> None:
    token = robot.token("Vera", Role.VIEWER)
    async with (
        line(robot, token) as one,
        line(robot, token) as other,
        line(robot, robot.token("Victor", Role.VIEWER)) as somebody_else,
    ):
        for _ in range(500):
            many = [one.ask("session/list") for _ in range(30)]
            await asyncio.gather(*many, other.ask("session/list"))  # alone, this one is not too often
            if other.refused:
                break
        assert other.refused
        assert "result" in await somebody_else.ask("session/list")


async def test_notifications_count_too(robot: Robot) -> None:
    async with line(robot, robot.token("Vera", Role.VIEWER)) as viewer:
        viewer.notify("_nonsense", 5000)
        assert (await viewer.ask("session/list"))["error"]["code"] == wire.LIMIT_EXCEEDED


async def test_a_cancel_behind_a_flood_ends_the_turn(robot: Robot) -> None:
    async with robot.watched() as watched, line(robot, robot.token("Olga", Role.OPERATOR)) as operator:
        session = (await operator.ask("session/new", cwd="/", mcpServers=[]))["result"]["sessionId"]
        await operator.ask("session/set_mode", sessionId=session, modeId="movement")
        prompt = [{"type": "text", "text": far(watched)}]
        turn = asyncio.create_task(operator.ask("session/prompt", sessionId=session, prompt=prompt))
        await watched.until(lambda: watched.speed > 0.1, "the robot to drive")
        operator.flood(5000)
        operator.notify("session/cancel", sessionId=session)
        assert (await turn)["result"]["stopReason"] == "cancelled"
        assert operator.refused, "the flood was no flood"
        assert watched.speed < 0.01


async def test_a_stop_behind_a_flood_stops(robot: Robot) -> None:
    async with (
        line(robot, robot.token("Vera", Role.VIEWER)) as viewer,
        line(robot, robot.token("Sue", Role.SUPERVISOR)) as supervisor,
    ):
        viewer.flood(5000)
        assert (await viewer.ask("_robot/stop"))["result"]["stopped"]["by"] == "Vera"
        assert viewer.refused, "the flood was no flood"
        assert (await supervisor.ask("_robot/release"))["result"] == {"stopped": None}


async def test_many_stops_and_cancels_are_all_carried_out(robot: Robot) -> None:
    async with (
        line(robot, robot.token("Olga", Role.OPERATOR)) as operator,
        line(robot, robot.token("Sue", Role.SUPERVISOR)) as supervisor,
    ):
        operator.notify("session/cancel", 700, sessionId="0" * 32)
        answers = await asyncio.gather(*[operator.ask("_robot/stop") for _ in range(40)])
        assert all("result" in answer for answer in answers)
        assert "result" in await supervisor.ask("_robot/release")
