"""The models of providers, through litellm. This is the only file that imports litellm.

litellm takes seconds to import, so `model` imports this file in a thread, when a model first needs it. Errors that a
person can mend become `ModelError` with advice; the texts of exceptions must never reach people.
"""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from typing import Any

import orjson

from backend.agent.sessions.history import Message, without_pictures
from backend.agent.turns.model import (
    Call,
    Cut,
    CutReason,
    ModelError,
    Part,
    Situation,
    Text,
    Thinking,
    ToolSchema,
    Usage,
)

# litellm reads this while it is imported; without it, it fetches a price list over the network.
os.environ.setdefault("LITELLM_LOCAL_MODEL_COST_MAP", "True")
import litellm

litellm.telemetry = False
litellm.suppress_debug_info = True
logging.getLogger("LiteLLM").setLevel(logging.WARNING)

log = logging.getLogger(__name__)

_MAX_AHEAD = 64
"""Parts that are read before the turn takes them; then the provider has to wait."""
_inferences: set[asyncio.Task[None]] = set()
"""The tasks in which litellm runs. Of a turn that was cancelled, such a task may end later than the turn."""
_CUTS: dict[str, CutReason] = {"length": "max_tokens", "content_filter": "refusal"}


@dataclass
class _PartialCall:
    id: str | None = None
    name: str = ""
    arguments: list[str] = field(default_factory=list)


async def stream(
    model: str, messages: list[Message], tools: list[ToolSchema], situation: Situation
) -> AsyncIterator[Part]:
    """Run one inference, as `model.Provider` says. The system message holds the situation. Raises `ModelError`.

    litellm runs in a task of its own, because it loses a cancel that comes at certain moments, for instance while it
    reads the error of a provider (on Python 3.11, `asyncio.wait_for` then returns as if nothing had happened). The
    caller waits for the parts alone, so its cancel ends the wait at once, whatever litellm does with its own.
    """
    parts: asyncio.Queue[Part | None] = asyncio.Queue()
    room = asyncio.Semaphore(_MAX_AHEAD)

    async def infer() -> None:
        async for part in _parts(model, messages, tools):
            await room.acquire()
            parts.put_nowait(part)

    def ended(task: asyncio.Task[None]) -> None:
        _inferences.discard(task)
        if not task.cancelled():
            task.exception()  # else asyncio complains of one that nobody waits for any more
        parts.put_nowait(None)

    inference = asyncio.create_task(infer(), name=f"inference of {model}")
    _inferences.add(inference)
    inference.add_done_callback(ended)
    try:
        while (part := await parts.get()) is not None:
            room.release()
            yield part
        if inference.cancelled():  # by litellm itself
            raise _explained(model, asyncio.CancelledError())
        inference.result()
    finally:
        inference.cancel()


async def _parts(model: str, messages: list[Message], tools: list[ToolSchema]) -> AsyncIterator[Part]:
    """The parts of one inference. Raises `ModelError`."""
    calls: list[_PartialCall] = []
    current: dict[int, _PartialCall] = {}
    try:
        if not _sees(model):
            messages = without_pictures(messages)
        response = await litellm.acompletion(
            model=model,
            messages=messages,
            stream=True,
            stream_options={"include_usage": True},
            **({"tools": tools} if tools else {}),
        )
        async for chunk in response:
            if usage := getattr(chunk, "usage", None):
                yield Usage(int(usage.total_tokens), _context_size(model))
            if not chunk.choices:
                continue
            if cut := _CUTS.get(chunk.choices[0].finish_reason or ""):
                yield Cut(cut)
            delta = chunk.choices[0].delta
            if thinking := getattr(delta, "reasoning_content", None):
                yield Thinking(thinking)
            if delta.content:
                yield Text(delta.content)
            for piece in delta.tool_calls or ():
                index = piece.index or 0
                # Some providers give every whole call the same index; a new id is a new call.
                if index not in current or (piece.id and current[index].id not in (None, piece.id)):
                    current[index] = _PartialCall()
                    calls.append(current[index])
                call = current[index]
                call.id = call.id or piece.id
                call.name = call.name or piece.function.name or ""
                call.arguments.append(piece.function.arguments or "")
    except Exception as error:  # litellm raises what its providers raise; all of it is about the model
        log.info("model %s failed: %s", model, type(error).__name__, exc_info=log.isEnabledFor(logging.DEBUG))
        raise _explained(model, error) from error
    for call in calls:
        yield Call(call.name, _arguments("".join(call.arguments)))


def _arguments(text: str) -> dict[str, Any] | None:
    try:
        parsed = orjson.loads(text or "{}")
    except ValueError:
        return None
    return parsed if isinstance(parsed, dict) else None


def _sees(model: str) -> bool:
    return bool(litellm.supports_vision(model=model))


def _context_size(model: str) -> int:
    try:
        return int(litellm.get_model_info(model)["max_input_tokens"] or 0)
    except Exception:
        return 0  # a model that the price list does not know


def _explained(model: str, error: BaseException) -> ModelError:
    """The error as a sentence for people. The exception's own text stays in the log: it can hold keys and addresses."""
    missing = [k for k in litellm.validate_environment(model).get("missing_keys") or [] if "KEY" in k or "TOKEN" in k]
    name = type(error).__name__
    if missing:
        return ModelError(
            f"The model {model} needs a key: set {' or '.join(missing)} where the agent runs and start it again, "
            f"or choose another model."
        )
    reasons = {
        "AuthenticationError": "refused the key. Check the key, or choose another model.",
        "RateLimitError": "is asked too often just now. Wait a minute, or choose another model.",
        "BadRequestError": "is not known or did not take the request. Check its name, or choose another model.",
        "NotFoundError": "is not known to its provider. Check the name, or choose another model.",
        "ContextWindowExceededError": "cannot take in a conversation this long. Start a new session.",
        "Timeout": "did not answer in time. Try again, or choose another model.",
    }
    reason = reasons.get(name, f"cannot be used just now ({name}). Check its name and the network, or choose another.")
    return ModelError(f"The model {model} {reason}")
