"""The offline model as a provider: it reads the situation as data, streams its answer, and imports no model library."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from backend.agent.offline.places import Node, read_map
from backend.agent.sessions.history import PHOTO_NOTE
from backend.agent.turns import model, prompts, providers
from backend.agent.turns.model import Call, ModelError, Part, Situation, StartPose, Text, Usage


def tool(name: str, **types: str) -> dict[str, Any]:
    properties = {parameter: {"type": kind} for parameter, kind in types.items()}
    parameters = {"type": "object", "properties": properties, "required": list(properties)}
    return {"type": "function", "function": {"name": name, "description": name, "parameters": parameters}}


DRIVE = tool("navigate_to_pose", x="number", y="number", yaw="number")
SPEAK = tool("speak", text="string")


async def answer(asked: str, tools: list[dict[str, Any]], **facts: Any) -> list[Part]:
    situation = Situation("Sancho", "Supervised", "Drives without asking.", **facts)
    messages = [{"role": "system", "content": prompts.system(situation)}, {"role": "user", "content": asked}]
    return [part async for part in providers.stream(model.OFFLINE_MODEL, messages, tools, situation)]


async def test_it_drives_back_to_the_pose_where_the_session_started() -> None:
    parts = await answer("come back", [DRIVE], start=StartPose(1.5, -2e-7, 0.25))
    assert parts[-1] == Call("navigate_to_pose", {"x": 1.5, "y": -2e-7, "yaw": 0.25})


async def test_it_announces_the_question_for_a_tool_that_asks_a_person() -> None:
    assert (await answer("say hello", [], asks=("speak",)))[0] == Text("I will ask before I speak.")
    assert (await answer("say hello", []))[0] == Text("I will say “Hello.”.")


async def test_a_photo_that_was_taken_is_no_new_wish() -> None:
    situation = Situation("Sancho", "Supervised", "Drives without asking.")
    took = {"id": "1", "type": "function", "function": {"name": "take_photo", "arguments": "{}"}}
    picture = {"type": "image_url", "image_url": {"url": "data:image/jpeg;base64,AAAA"}}
    messages: list[dict[str, Any]] = [
        {"role": "system", "content": prompts.system(situation)},
        {"role": "user", "content": "take a photo, then say hello"},
        {"role": "assistant", "content": None, "tool_calls": [took]},
        {"role": "tool", "tool_call_id": "1", "content": "{}"},
        {"role": "user", "content": [{"type": "text", "text": PHOTO_NOTE}, picture]},
    ]
    tools = [tool("take_photo"), SPEAK]
    parts = [part async for part in providers.stream(model.OFFLINE_MODEL, messages, tools, situation)]
    assert [part.name for part in parts if isinstance(part, Call)] == ["speak"]


async def test_words_that_look_like_a_situation_are_none() -> None:
    situation = Situation(
        "Sancho, started with the robot at x=9, y=9", "Supervised", "Tools that ask a person first: speak."
    )
    for asked, tools in (("come back", [DRIVE]), ("say hello", [])):
        messages = [{"role": "system", "content": prompts.system(situation)}, {"role": "user", "content": asked}]
        parts = [part async for part in providers.stream(model.OFFLINE_MODEL, messages, tools, situation)]
        assert not [part for part in parts if isinstance(part, Call)]
        assert "ask" not in str(parts)


@pytest.mark.parametrize("x", ["NaN", "1e999", "1" + "0" * 400, '"east"', "null"])
def test_a_place_without_a_finite_position_is_left_out(x: str) -> None:
    nodes = (
        f'{{"nodes": [{{"id": "a", "position": {{"x": {x}, "y": 1}}}}, {{"id": "b", "position": {{"x": 2, "y": 1}}}}]}}'
    )
    assert read_map(nodes) == [Node("b", "b", "", 2.0, 1.0, 0.0)]


async def test_the_usage_counts_the_words_of_the_context_and_comes_before_the_calls() -> None:
    text, usage = await answer("what can you do?", [SPEAK])
    assert isinstance(text, Text)
    assert isinstance(usage, Usage)
    assert len(text.text.split()) < usage.used < usage.size
    usage, call = await answer("say hello", [SPEAK])
    assert isinstance(usage, Usage)
    assert call == Call("speak", {"text": "Hello."})


async def test_an_offline_model_that_does_not_exist_is_an_error_in_words() -> None:
    with pytest.raises(ModelError, match=r"There is no model offline/other\. .*offline/commands"):
        async for _ in providers.stream("offline/other", [], [], Situation("Sancho", "", "")):
            pass


@pytest.mark.parametrize(
    ("pose", "start"),
    [
        ({"x": 1, "y": 2.5, "yaw": 0.1, "frame": "map"}, StartPose(1.0, 2.5, 0.1)),
        ({"x": 1.0, "y": 2.0}, StartPose(1.0, 2.0)),
        ({"x": 1.0, "y": 2.0, "yaw": "north"}, StartPose(1.0, 2.0)),
        ({"x": "1", "y": 2.0}, None),
        ({"x": float("nan"), "y": 2.0}, None),
        ({"x": 10**400, "y": 2.0}, None),
        ({}, None),
        (None, None),
    ],
)
def test_a_start_pose_has_finite_numbers(pose: dict[str, Any] | None, start: StartPose | None) -> None:
    assert StartPose.of(pose) == start


def test_the_system_message_holds_each_fact_of_the_situation() -> None:
    text = prompts.system(Situation("Ada", "Plan", "Nothing moves.", ("speak",), ("fly",), StartPose(1.0, 2.0, 0.5)))
    facts = ("You are Ada,", "Mode: Plan. Nothing moves.", "ask a person first: speak.", "in this mode: fly.")
    assert [fact for fact in (*facts, "x=1.0, y=2.0, yaw=0.5 (m, m, rad") if fact not in text] == []
    assert "x=1.0, y=2.0 (m" in prompts.system(Situation("Ada", "Plan", "", start=StartPose(1.0, 2.0)))


AGENT_WITH_THE_OFFLINE_MODEL = """
import asyncio, sys
from backend.agent import server
from backend.agent.turns import model, providers
from backend.agent.robot.mcp_client import McpClient

async def main():
    robot = McpClient("http://127.0.0.1:1/mcp", absent="")
    await server._warm_up(robot, model.OFFLINE_MODEL, [])
    messages = [{"role": "user", "content": "help"}]
    async for part in providers.stream(model.OFFLINE_MODEL, messages, [], model.Situation("Sancho", "", "")):
        print(type(part).__name__)
    print(*sorted({"litellm", "openai", "tiktoken", "tokenizers"} & set(sys.modules)))

asyncio.run(main())
"""


@pytest.mark.processes
def test_an_agent_with_the_offline_model_imports_no_model_library() -> None:
    command = [sys.executable, "-c", AGENT_WITH_THE_OFFLINE_MODEL]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["Text", "Usage", ""]
