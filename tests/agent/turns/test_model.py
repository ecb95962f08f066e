"""The parts that are made of litellm's stream: calls are put together by id, and no odd delta ends the turn."""

from __future__ import annotations

from collections.abc import AsyncIterator
from types import SimpleNamespace
from typing import Any

import pytest

from backend.agent.turns import litellm_models, model, providers


def delta(index: int | None, call_id: str | None, name: str | None, arguments: str | None) -> Any:
    function = SimpleNamespace(name=name, arguments=arguments)
    piece = SimpleNamespace(index=index, id=call_id, function=function)
    choice = SimpleNamespace(
        delta=SimpleNamespace(content=None, reasoning_content=None, tool_calls=[piece]), finish_reason=None
    )
    return SimpleNamespace(choices=[choice], usage=None)


async def calls_of(monkeypatch: pytest.MonkeyPatch, *deltas: Any) -> list[model.Part]:
    async def stream() -> AsyncIterator[Any]:
        for chunk in deltas:
            yield chunk

    async def acompletion(**_options: Any) -> Any:
        return stream()

    monkeypatch.setattr(litellm_models.litellm, "acompletion", acompletion)
    situation = model.Situation("Sancho", "Supervised", "Drives without asking.")
    return [part async for part in providers.stream("openai/m", [{"role": "user", "content": "x"}], [], situation)]


async def test_two_whole_calls_with_one_index_are_two(monkeypatch: pytest.MonkeyPatch) -> None:
    parts = await calls_of(monkeypatch, delta(0, "a", "look", "{}"), delta(0, "b", "speak", '{"text":"hi"}'))
    assert parts == [model.Call("look", {}), model.Call("speak", {"text": "hi"})]


async def test_a_name_that_is_repeated_is_taken_once(monkeypatch: pytest.MonkeyPatch) -> None:
    parts = await calls_of(monkeypatch, delta(0, "a", "look", '{"x"'), delta(0, None, "look", ":1}"))
    assert parts == [model.Call("look", {"x": 1})]


async def test_calls_that_come_interleaved_are_kept_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    pieces = [
        delta(0, "a", "look", "{"),
        delta(1, "b", "speak", "{"),
        delta(0, None, None, "}"),
        delta(1, None, None, "}"),
    ]
    assert await calls_of(monkeypatch, *pieces) == [model.Call("look", {}), model.Call("speak", {})]


@pytest.mark.parametrize("arguments", ['{"a"', "[1]", '"x"', "null", '{"text":"\\ud83d"}'])
async def test_arguments_that_are_no_object_are_told_so(monkeypatch: pytest.MonkeyPatch, arguments: str) -> None:
    assert await calls_of(monkeypatch, delta(0, "a", "look", arguments)) == [model.Call("look", None)]
