"""The inferences of one turn, shown to people as they come: the preliminary thought, and each step of the loop.

What they say is all that happens here: nothing is decided and no tool is called.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import Any

from backend.agent.acp import updates
from backend.agent.sessions.history import Message
from backend.agent.sessions.session import Session
from backend.agent.turns import model, prompts
from backend.agent.turns.chunks import Chunks
from backend.agent.turns.phases import Phases

log = logging.getLogger(__name__)

Infer = Callable[[str, list[Message], list[dict[str, Any]]], AsyncIterator[model.Part]]


@dataclass(eq=False)
class Inferences:
    """What the model is asked in one turn of `session`."""

    session: Session
    infer: Infer
    thought_timeout_s: float
    phases: Phases
    other_model: str | None = None
    """What runs this turn, where it is not the session's model."""
    usage: updates.Update | None = None
    """The context in use after the last step; None before."""

    async def think(self, system: str) -> None:
        """The preliminary thought. That it fails is no reason not to go on."""
        messages = [{"role": "system", "content": prompts.thought(system)}, *self.session.history.messages()]
        words = Chunks(lambda text: self.session.record(updates.thought(text)))
        with self.phases.during("thought"):
            try:
                async with asyncio.timeout(self.thought_timeout_s):
                    async for part in self._stream(messages, []):
                        if isinstance(part, model.Text):
                            words.add(part.text)
            except (TimeoutError, model.ModelError) as error:
                log.info("no preliminary thought: %s", error or "too slow")
            words.flush()

    async def step(
        self, system: str, schemas: list[dict[str, Any]], thinking: asyncio.Task[None]
    ) -> tuple[list[model.Call], model.CutReason | None]:
        """One step of the loop; what it says is shown as it comes, but never before the preliminary thought is."""
        calls: list[model.Call] = []
        cut: model.CutReason | None = None
        said = Chunks(lambda text: self.session.record(updates.message(text)))
        thoughts = Chunks(lambda text: self.session.record(updates.thought(text)))
        messages = [{"role": "system", "content": system}, *self.session.history.messages()]
        with self.phases.during("inference"):
            async for part in self._stream(messages, schemas):
                await asyncio.wait([thinking])
                match part:
                    case model.Text(text):
                        thoughts.flush()
                        said.add(text)
                    case model.Thinking(text):
                        said.flush()
                        thoughts.add(text)
                    case model.Call():
                        calls.append(part)
                    case model.Usage(used, size):
                        self.usage = updates.usage(used, size)
                    case model.Cut(reason):
                        cut = reason
            thoughts.flush()
            said.flush()
        return calls, cut

    def _stream(self, messages: list[Message], schemas: list[dict[str, Any]]) -> AsyncIterator[model.Part]:
        return self.infer(self.other_model or self.session.row.model, messages, schemas)
