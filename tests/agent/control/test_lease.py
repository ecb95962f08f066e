"""One robot, one controller: in line, in order, and taken over by a supervisor alone."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from backend.agent.control.lease import Claim, HeldByAnother, Lease
from backend.chat.link import RefusedError
from backend.identity import Role
from tests.agent.conftest import Opener, holds_the_robot
from tests.processes import Client, Robot, eventually


def claim(session_id: str, lost: list[str] | None = None) -> Claim:
    return Claim(session_id, f"owner of {session_id}", (lost if lost is not None else []).append)


def test_the_first_holds_it_and_the_others_follow_in_order() -> None:
    lease, a, b, c = Lease(), claim("a"), claim("b"), claim("c")
    assert [lease.ask(x) for x in (a, b, c)] == [True, False, False]
    lease.release(a)
    assert lease.holder is b
    lease.release(b)
    assert lease.holder is c
    lease.release(c)
    assert lease.holder is None


def test_one_who_leaves_the_line_is_skipped_and_releasing_twice_is_harmless() -> None:
    lease, a, b, c = Lease(), claim("a"), claim("b"), claim("c")
    for x in (a, b, c):
        lease.ask(x)
    lease.release(b)
    lease.release(a)
    lease.release(a)
    assert lease.holder is c


def test_taking_over_ends_the_holder_and_puts_the_session_first() -> None:
    lost: list[str] = []
    lease, a, b, c = Lease(), claim("a", lost), claim("b"), claim("c")
    for x in (a, b, c):
        lease.ask(x)
    assert lease.take_over("c", "Sue") is a
    assert lost == ["Sue took the robot over"]
    assert lease.holder is a, "it is held until the robot is at rest"
    lease.release(a)
    assert lease.holder is c


def test_whoever_is_taken_over_is_the_one_who_was_meant() -> None:
    lost: list[str] = []
    lease, a, b, c = Lease(), claim("a", lost), claim("b", lost), claim("c", lost)
    for x in (a, b, c):
        lease.ask(x)
    lease.release(a)
    with pytest.raises(HeldByAnother) as error:
        lease.take_over("c", "Sue", meant="a")
    assert error.value.holder == "owner of b"
    assert lost == []
    assert lease.waiting == (c,)
    assert lease.take_over("c", "Sue", meant="b") is b
    lease.release(b)
    lease.release(c)
    assert lease.take_over(None, "Sue", meant="c") is None  # nobody has it any more


def test_a_line_keeps_its_order_when_somebody_else_was_meant() -> None:
    lease, a, b, c = Lease(), claim("a"), claim("b"), claim("c")
    for x in (a, b, c):
        lease.ask(x)
    with pytest.raises(HeldByAnother):
        lease.take_over("c", "Sue", meant="b")
    assert lease.waiting == (b, c)


def told_last(client: Client) -> dict[str, Any] | None:
    """Whose turn the robot's is, as the client was told last."""
    turns = [message["params"]["turn"] for message in client.heard if message["method"] == "_robot/telemetry"]
    return turns[-1] if turns else None


async def test_the_second_waits_with_a_reason_and_a_supervisor_takes_over(robot: Robot, connect: Opener) -> None:
    ana = await connect(robot.token("Ana", Role.OPERATOR), answer=None)
    ben = await connect(robot.token("Ben", Role.OPERATOR))
    asks = {"_meta": {"robot-acp/telemetry": {"rate": 10}}}
    sue = await connect(robot.token("Sue", Role.SUPERVISOR), capabilities=asks)
    vic = await connect(robot.token("Vic", Role.VISITOR), capabilities=asks)
    first = await holds_the_robot(ana)
    session = await ben.new()
    second = asyncio.create_task(ben.prompt("turn left by 20 degrees"))
    await eventually(lambda: any("which Ana has now" in str(u) for u in ben.updates), "the reason to wait")
    line = {"sessionId": ana.session, "by": "Ana", "queue": 1}
    await eventually(lambda: told_last(vic) == line, "the line, as everybody is told")
    line["waiting"] = [{"sessionId": session, "by": "Ben"}]
    await eventually(lambda: told_last(sue) == line, "the line, with names")
    with pytest.raises(RefusedError, match="may not take over"):
        await ben.link.request("_robot/take_over", {"sessionId": session})
    with pytest.raises(RefusedError, match="Ana has the robot now"):
        await sue.link.request("_robot/take_over", {"sessionId": session, "from": session})
    with pytest.raises(RefusedError, match="from must be the id of a session"):
        await sue.link.request("_robot/take_over", {"sessionId": session, "from": 5})
    took = await sue.link.request("_robot/take_over", {"sessionId": session, "from": ana.session})
    assert took["from"] == "Ana"
    assert await first == "cancelled"
    assert "Sue took the robot over" in ana.said
    assert [m for u in ana.updates if (m := (u.get("_meta") or {}).get("robot-acp/taken_over"))] == [{"by": "Sue"}]
    assert await second == "end_turn"
    assert "I turned left by 20°." in ben.said


async def test_cancelling_one_who_waits_leaves_the_line_to_the_others(connect: Opener) -> None:
    holding, waiting, last = await connect(answer=None), await connect(), await connect()
    for client in (waiting, last):
        await client.new()
    held = await holds_the_robot(holding)
    giving_up = asyncio.create_task(waiting.prompt("turn left by 20 degrees"))
    await eventually(lambda: "waiting for the robot" in str(waiting.updates), "the wait")
    turning = asyncio.create_task(last.prompt("turn left by 20 degrees"))
    await eventually(lambda: "waiting for the robot" in str(last.updates), "the wait")
    await waiting.cancel()
    assert await giving_up == "cancelled"
    await holding.decide("allow_once")
    assert await held == "end_turn"
    assert await turning == "end_turn"


async def test_looking_needs_no_lease(connect: Opener) -> None:
    holding, looking = await connect(answer=None), await connect()
    await looking.new()
    held = await holds_the_robot(holding)
    assert await looking.prompt("where are you?") == "end_turn"
    assert not held.done()
    await holding.decide("reject_once")
    assert await held == "end_turn"
