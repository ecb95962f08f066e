"""Which provider runs a model: `offline/` is ours, litellm knows every other name.

A provider is loaded when a model of it is used, and not before: litellm takes seconds of CPU and 160 MB, which an agent
with the offline model never pays. So this file must never import a provider at its top.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

from backend.agent.sessions.history import Message
from backend.agent.turns.model import Part, Provider, Situation, ToolSchema


def _provider(model: str) -> Provider:
    """Load the provider of `model`: seconds for litellm the first time, so never on the event loop."""
    if model.startswith("offline/"):
        from backend.agent.offline import provider

        return provider
    from backend.agent.turns import litellm_models

    return litellm_models


async def ready(model: str) -> None:
    """Return when the provider of `model` is loaded; from then on an inference starts at once."""
    await asyncio.to_thread(_provider, model)


async def stream(
    model: str, messages: list[Message], tools: list[ToolSchema], situation: Situation
) -> AsyncIterator[Part]:
    """Run one inference at the provider of `model`, as `Provider.stream` says. Raises `ModelError`."""
    provider = await asyncio.to_thread(_provider, model)
    async for part in provider.stream(model, messages, tools, situation):
        yield part
