"""A step that failed is not ticked: not by the offline model, and not for a language model that ticks it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from backend.agent.turns.plan import Plan
from tests.agent.conftest import TIME_SCALE, Opener
from tests.agent.turns.test_other_models import Provider, call, client_of, end, text
from tests.processes import Client, Robot


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """A fast robot and its agent."""
    with Robot(tmp_path_factory.mktemp("data")).at_work("--time-scale", TIME_SCALE, bridge=False) as robot:
        yield robot


def plans(client: Client) -> list[list[str]]:
    return [[entry["status"] for entry in plan["entries"]] for plan in client.of("plan")]


async def test_what_a_person_refused_is_not_done(connect: Opener) -> None:
    client = await connect(answer="reject_once")
    await client.new()
    await client.prompt("turn left by 20 degrees, say hello and then tell me where you are")
    assert plans(client)[-1] == ["completed", "pending", "completed"]
    assert ["completed", "pending", "in_progress"] in plans(client)


async def test_a_drive_that_failed_and_what_was_left_out_are_not_done(connect: Opener) -> None:
    client = await connect()
    await client.new()
    await client.prompt("turn left by 20 degrees, go to (400, 300) and then turn right by 20 degrees")
    assert plans(client)[-1] == ["completed", "pending", "pending"]


async def test_a_place_that_is_not_there_leaves_no_step_under_way(connect: Opener) -> None:
    client = await connect()
    await client.new()
    await client.prompt("go to atlantis and then turn left by 20 degrees")
    assert plans(client)[-1] == ["pending", "pending"]


async def test_what_was_done_is_done(connect: Opener) -> None:
    client = await connect()
    await client.new()
    await client.prompt("turn left by 20 degrees and then say hello")
    assert plans(client)[-1] == ["completed", "completed"]


def planned(*statuses: str) -> dict[str, Any]:
    steps = ["Turn a little", "Say hello", "Turn back"]
    entries = [{"content": step, "status": status} for step, status in zip(steps, statuses, strict=True)]
    return call("update_plan", json.dumps({"entries": entries}))


def tool(name: str, **arguments: Any) -> dict[str, Any]:
    return call(name, json.dumps(arguments))


async def test_a_language_model_that_ticks_a_failed_step_is_not_believed(robot: Robot) -> None:
    provider = Provider(
        [
            [planned("in_progress", "pending", "pending"), end("tool_calls")],
            [tool("rotate_in_place", degrees=20), end("tool_calls")],
            [planned("completed", "in_progress", "pending"), end("tool_calls")],
            [tool("speak", text=""), end("tool_calls")],
            [planned("completed", "completed", "in_progress"), end("tool_calls")],
            [tool("rotate_in_place", degrees=-20), end("tool_calls")],
            [planned("completed", "completed", "completed"), end("tool_calls")],
            [text("All done."), end("stop")],
        ]
    )
    async with provider.running(), client_of(robot, provider) as client:
        client.answer = "reject_once"
        assert await client.prompt("turn, say hello, turn back") == "end_turn"
        assert plans(client)[2:] == [["completed", "pending", "in_progress"], ["completed", "pending", "completed"]]
    remembered = [m for m in provider.asked[-1]["messages"] if "update_plan" in str(m.get("tool_calls"))]
    assert '"Say hello", "status": "pending"' in str(remembered[-1]["tool_calls"])


def steps(*statuses: str, names: str = "ABC") -> list[dict[str, Any]]:
    return [
        {"content": name, "priority": "medium", "status": status} for name, status in zip(names, statuses, strict=True)
    ]


def test_a_later_call_of_the_same_kind_makes_up_for_one_that_failed() -> None:
    plan = Plan()
    plan.revised(steps("in_progress", "pending", "pending"))
    plan.call_ended("navigation", failed=True)
    plan.call_ended("speech", failed=False)
    assert plan.revised(steps("completed", "pending", "pending"))[0]["status"] == "pending"
    plan.revised(steps("in_progress", "pending", "pending"))
    plan.call_ended("navigation", failed=False)
    assert plan.revised(steps("completed", "pending", "pending"))[0]["status"] == "completed"


@pytest.mark.parametrize("names", ["XBC", "BAC", "BCA"])
def test_a_failed_step_stays_failed_in_other_words_and_at_another_place(names: str) -> None:
    plan = Plan()
    plan.revised(steps("in_progress", "pending", "pending"))
    plan.call_ended("navigation", failed=True)
    shown = plan.revised(steps("completed", "completed", "completed", names=names))
    failed = names.index("A") if "A" in names else 0
    assert [step["status"] for step in shown] == ["pending" if i == failed else "completed" for i in range(3)]


def test_without_a_plan_a_failed_call_marks_nothing() -> None:
    plan = Plan()
    plan.call_ended("navigation", failed=True)
    assert plan.revised(steps("completed", "completed", "completed")) == steps("completed", "completed", "completed")
