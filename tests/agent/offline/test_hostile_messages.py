"""No message takes the offline model long: neither a person's prompt, nor a tool's result, nor a tool's name.

Its patterns run in a thread, but a pattern keeps the interpreter to itself, so the event loop would wait for it.
"""

from __future__ import annotations

import json
import time
from typing import Any

import pytest

from backend.agent.offline.commands import respond
from backend.agent.turns.model import Situation
from tests.agent.offline.test_grammar import HEADS, PIECES
from tests.agent.offline.test_provider import tool

LENGTH = 100_000
SITUATION = Situation("Sancho", "Supervised", "Drives without asking.")
NODE = {"id": "desk", "name": "the desk", "position": {"x": 1, "y": 2}}
MAP, DRIVE, SPEAK = tool("get_map"), tool("go_to_place", place="string"), tool("speak", text="string")


def messages(asked: str, *results: tuple[str, str]) -> list[dict[str, Any]]:
    calls = [
        {"id": str(number), "type": "function", "function": {"name": name, "arguments": "{}"}}
        for number, (name, _) in enumerate(results)
    ]
    answers = [{"role": "tool", "tool_call_id": str(i), "content": text} for i, (_, text) in enumerate(results)]
    return [{"role": "user", "content": asked}, {"role": "assistant", "content": None, "tool_calls": calls}, *answers]


def answered_soon(talk: list[dict[str, Any]], tools: list[dict[str, Any]]) -> None:
    """The limit is for a machine that is a hundred times slower."""
    before = time.process_time()
    respond(talk, tools, SITUATION)
    assert time.process_time() - before < 1


@pytest.mark.parametrize("head", HEADS)
def test_a_prompt(head: str) -> None:
    nodes = json.dumps({"nodes": [NODE] * 50})
    for piece in PIECES:
        text = (head + piece * LENGTH)[:LENGTH]
        for prompt in (text, f"go to {text[:1_900]}", f"say {text[:1_900]}"):
            answered_soon(messages(prompt), [])
            answered_soon(messages(prompt, ("get_map", nodes)), [MAP, DRIVE, SPEAK])


@pytest.mark.parametrize("piece", [*PIECES, "[", '{"a":', "Error: ", "the ", "_", "é"])
def test_a_result_of_a_tool(piece: str) -> None:
    text = (piece * LENGTH)[:LENGTH]
    for result in (text, "Error: " + text, json.dumps({"nodes": [NODE | {"id": text, "name": text}]})):
        answered_soon(messages("go to the desk", ("get_map", result)), [MAP, DRIVE])
        answered_soon(messages("say hello", ("speak", result)), [MAP, SPEAK])
        answered_soon(messages("how is the battery?", ("get_status", result)), [tool("get_status")])
        answered_soon(messages("where are you?", ("get_pose", result)), [tool("get_pose")])


@pytest.mark.parametrize("value", ["a", None, [], {}, True, 1e308, 10**400, float("nan")])
def test_a_value_that_is_no_number_of_a_place(value: object) -> None:
    pose = json.dumps({"x": value, "y": value, "yaw": value, "battery": value, "path_length": value, "reached": False})
    for prompt, name in (("where are you?", "get_pose"), ("how is the battery?", "get_status")):
        assert respond(messages(prompt, (name, pose)), [tool(name)], SITUATION).text
    moved = messages("go to 1, 2", ("drive", pose))
    assert respond(moved, [tool("drive", x="number", y="number")], SITUATION).text


@pytest.mark.parametrize("piece", [*PIECES, "_", "go_to_", "pose"])
def test_a_name_of_a_tool(piece: str) -> None:
    name = (piece * LENGTH)[:LENGTH]
    for prompt in ("go to the desk", "say hello", "what can you do?", "take a photo"):
        answered_soon(messages(prompt), [tool(name, x="number", text="string")])
