"""The command grammar as a provider of models. It needs no library, and it must not import one."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

from backend.agent.offline.commands import Reply, respond
from backend.agent.sessions.history import Message, without_pictures
from backend.agent.turns.model import OFFLINE_MODEL, Call, ModelError, Part, Situation, Text, ToolSchema, Usage

CONTEXT_WORDS = 100_000
"""The size of the context that is reported to people; a word counts as a token."""


async def stream(
    model: str, messages: list[Message], tools: list[ToolSchema], situation: Situation
) -> AsyncIterator[Part]:
    """Run one inference, as `model.Provider` says. Raises `ModelError` for an offline model that does not exist."""
    if model != OFFLINE_MODEL:
        raise ModelError(f"There is no model {model}. Check its name, or choose {OFFLINE_MODEL}.")
    # In a thread: a long text or a large map costs the grammar more time than the event loop has.
    reply, used = await asyncio.to_thread(_reply, messages, tools, situation)
    if reply.text:
        yield Text(reply.text)
    yield Usage(used, CONTEXT_WORDS)
    for name, arguments in reply.calls:
        yield Call(name, arguments)


def _reply(messages: list[Message], tools: list[ToolSchema], situation: Situation) -> tuple[Reply, int]:
    messages = without_pictures(messages)  # a photo of the robot's own is no new wish of a person
    reply = respond(messages, tools, situation)
    return reply, len(reply.text.split()) + sum(len(str(m.get("content") or "").split()) for m in messages)
