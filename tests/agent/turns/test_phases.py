"""What a turn spent its time on: the phases add up, each moment counts once, and people's time is people's."""

from __future__ import annotations

import asyncio
import contextlib
import time

import pytest

from backend.agent.control.policy import ToolTraits
from backend.agent.turns.phases import PHASES, Phases, phase_of
from tests.agent.conftest import Opener, holds_the_robot
from tests.processes import Client, eventually

NAMES = {*PHASES, "protocols", "total"}


class Clock:
    """Seconds that pass when a test says so."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def phases_of(client: Client) -> list[dict[str, float]]:
    """Of each turn that has ended, in order."""
    metas = [update.get("_meta") or {} for update in client.of("session_info_update")]
    return [meta["robot-acp/phases"] for meta in metas if "robot-acp/phases" in meta]


def test_every_moment_counts_for_one_phase() -> None:
    clock = Clock()
    phases = Phases(clock)
    clock.now = 1
    with phases.during("inference"):
        clock.now = 3
    clock.now = 3.5
    with phases.during("navigation"):
        clock.now = 10
    told = phases.seconds()
    assert (told["inference"], told["navigation"], told["protocols"], told["total"]) == (2, 6.5, 1.5, 10)
    assert set(told) == NAMES
    assert told["total"] == pytest.approx(sum(seconds for name, seconds in told.items() if name != "total"))


def test_the_inference_beside_the_thought_counts_from_where_the_thought_is_out() -> None:
    clock = Clock()
    phases = Phases(clock)
    with phases.during("inference"):
        with phases.during("thought"):
            clock.now = 2
        clock.now = 5
    assert phases.seconds() | {"total": 0} == dict.fromkeys(NAMES, 0) | {"thought": 2, "inference": 3}


def test_a_phase_that_an_error_ends_has_ended() -> None:
    clock = Clock()
    phases = Phases(clock)
    with contextlib.suppress(asyncio.CancelledError), phases.during("navigation"):
        clock.now = 2
        raise asyncio.CancelledError
    clock.now = 3
    assert (phases.seconds()["navigation"], phases.seconds()["protocols"]) == (2, 1)


@pytest.mark.parametrize(
    ("tool", "looks", "phase"),
    [
        (ToolTraits("navigate_to_place", False), False, "navigation"),
        (ToolTraits("fly", False, can_preview=True), False, "navigation"),
        (ToolTraits("fly", False, can_preview=True), True, "tools"),
        (ToolTraits("speak", False), False, "speech"),
        (ToolTraits("get_topological_map", True), True, "tools"),
        (ToolTraits("open_gripper", None), False, "tools"),
    ],
)
def test_what_a_tool_does_is_what_its_time_counts_as(tool: ToolTraits, looks: bool, phase: str) -> None:
    assert phase_of(tool, looks) == phase


async def test_the_papers_prompt_tells_how_long_each_phase_took(connect: Opener) -> None:
    client, beside = await connect(answer=None), await connect()
    await client.new()
    await beside.new()
    turn = client.later(client.prompt("Go to lab 2.3.7 and tell them that the meeting is at noon"))
    await eventually(lambda: client.questions, "the question")
    asked = time.monotonic()
    await beside.prompt("where are you?")  # the person looks before they answer
    thought_for = time.monotonic() - asked
    await client.decide("allow_once")
    assert await turn == "end_turn"
    (told,) = phases_of(client)
    assert set(told) == NAMES
    assert told["total"] == pytest.approx(sum(seconds for name, seconds in told.items() if name != "total"), abs=1e-6)
    assert all(told[name] > 0 for name in ("thought", "inference", "navigation", "speech", "tools", "protocols"))
    assert told["person"] >= thought_for
    assert told["waiting"] == 0
    counts_as = [update["_meta"]["robot-acp/phase"] for update in client.of("tool_call")]
    assert counts_as == ["tools", "navigation", "speech"]


async def test_the_phases_are_those_that_the_times_of_the_events_show(connect: Opener) -> None:
    client = await connect()
    session = await client.new()
    await client.prompt("go to the kitchen")
    archive = await connect(answer=None)
    await archive.load(session)
    (told,) = phases_of(archive)
    at = [event["_meta"]["robot-acp/at"] for event in archive.events]
    assert told["total"] == pytest.approx(at[-1] - at[0], abs=0.5)
    drive = next(u["toolCallId"] for u in archive.of("tool_call") if u["_meta"]["robot-acp/phase"] == "navigation")
    of_drive = [e for e in archive.events if e["update"].get("toolCallId") == drive]
    begun = next(e["_meta"]["robot-acp/at"] for e in of_drive if e["update"].get("status") == "in_progress")
    assert told["navigation"] == pytest.approx(of_drive[-1]["_meta"]["robot-acp/at"] - begun, abs=0.5)


async def test_waiting_for_the_robot_is_told_as_such(connect: Opener) -> None:
    holding, waiting = await connect(answer=None), await connect()
    await waiting.new()
    first = await holds_the_robot(holding)
    since = time.monotonic()
    second = waiting.later(waiting.prompt("turn left by 10 degrees"))
    await eventually(lambda: "waiting for the robot" in str(waiting.updates), "the wait")
    await holding.cancel()
    assert await first == "cancelled"
    assert await second == "end_turn"
    (told,) = phases_of(waiting)
    assert 0 < told["waiting"] < time.monotonic() - since
    assert phases_of(holding)[0]["person"] > 0
