"""The inferences of one turn: the preliminary thought, and one inference for each step of the loop.

People read the words while the model writes them. Nothing is decided here, and no tool is called.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass

from backend.agent.acp import updates
from backend.agent.sessions.history import Message
from backend.agent.sessions.session import Session
from backend.agent.turns import model, prompts
from backend.agent.turns.phases import Phases

log = logging.getLogger(__name__)

Infer = Callable[[str, list[Message], list[model.ToolSchema], model.Situation], AsyncIterator[model.Part]]
"""`providers.stream`, or another function of its form in a test."""

_CHUNK_S = 0.04
"""A chunk holds the words of at least this time, so that the log and the clients get fewer events than words."""


class _Chunks:
    """Joins the words of a stream and hands them to `show` in chunks; `flush` hands over the rest."""

    def __init__(self, show: Callable[[str], None]) -> None:
        self._show = show
        self._text = ""
        self._last = time.monotonic()

    def add(self, text: str) -> None:
        self._text += text
        if time.monotonic() - self._last >= _CHUNK_S:
            self.flush()

    def flush(self) -> None:
        if self._text:
            self._show(self._text)
            self._text = ""
            self._last = time.monotonic()


@dataclass(eq=False)
class Inferences:
    """Runs the inferences of one turn of `session`."""

    session: Session
    infer: Infer
    thought_timeout_s: float
    phases: Phases
    other_model: str | None = None
    """The model of this turn, where it is not the session's."""
    usage: updates.Update | None = None
    """The model's context after the last step, as an update; None before the first."""

    @property
    def model_name(self) -> str:
        """The name of the model that runs this turn. It follows a change of the session's model in mid-turn."""
        return self.other_model or self.session.row.model

    async def think(self, situation: model.Situation) -> None:
        """Run the inference of the preliminary thought. The turn goes on when it fails."""
        words = _Chunks(lambda text: self.session.record(updates.thought(text)))
        with self.phases.during("thought"):
            try:
                async with asyncio.timeout(self.thought_timeout_s):
                    async for part in self._stream(prompts.thought(situation), [], situation):
                        if isinstance(part, model.Text):
                            words.add(part.text)
            except (TimeoutError, model.ModelError) as error:
                log.info("no preliminary thought: %s", error or "too slow")
            words.flush()

    async def step(
        self, situation: model.Situation, tools: list[model.ToolSchema], thinking: asyncio.Task[None]
    ) -> tuple[list[model.Call], model.CutReason | None]:
        """Run the inference of one step; return its calls, and why it was cut off if it was.

        Its words are shown as they come, but only after the end of `thinking`, the preliminary thought.
        """
        calls: list[model.Call] = []
        cut: model.CutReason | None = None
        said = _Chunks(lambda text: self.session.record(updates.message(text)))
        thoughts = _Chunks(lambda text: self.session.record(updates.thought(text)))
        with self.phases.during("inference"):
            async for part in self._stream(prompts.system(situation), tools, situation):
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

    def _stream(
        self, system: str, tools: list[model.ToolSchema], situation: model.Situation
    ) -> AsyncIterator[model.Part]:
        messages = [{"role": "system", "content": system}, *self.session.history.messages()]
        return self.infer(self.model_name, messages, tools, situation)
