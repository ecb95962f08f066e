"""The interface to models: one inference takes messages, tools and the situation, and streams the parts of an answer.

Types only. `providers.py` finds the provider that runs a model. This file must never import a provider.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from backend.agent.sessions.history import Message

OFFLINE_MODEL = "offline/commands"

ToolSchema = dict[str, Any]
"""A tool as chat models take it: `{"type": "function", "function": {"name", "description", "parameters"}}`."""


class ModelError(Exception):
    """The model cannot be used; the text says why and what a person can do."""


@dataclass(frozen=True)
class StartPose:
    """Where the robot was when the session began, in the map frame: `x` and `y` in m, `yaw` in rad if it is known."""

    x: float
    y: float
    yaw: float | None = None

    @classmethod
    def of(cls, pose: dict[str, Any] | None) -> StartPose | None:
        """The pose that the robot's pose tool reported; None without finite numbers for `x` and `y`."""
        x, y, yaw = (_finite((pose or {}).get(key)) for key in ("x", "y", "yaw"))
        return None if x is None or y is None else cls(x, y, yaw)


def _finite(value: object) -> float | None:
    with contextlib.suppress(OverflowError):  # an integer of JSON can be larger than every float
        if isinstance(value, int | float) and math.isfinite(value):
            return float(value)
    return None


@dataclass(frozen=True)
class Situation:
    """The facts of a session that an inference needs beside the conversation.

    A language model reads them as the system message that `prompts.system` makes of them; the offline model reads them
    here.
    """

    robot: str
    """The robot's name."""
    mode: str
    """The mode's name, as people see it."""
    mode_text: str
    """What the mode allows, as one sentence."""
    asks: tuple[str, ...] = ()
    """Names of the tools that run only after a person has allowed the call."""
    denied: tuple[str, ...] = ()
    """Names of the tools that the mode denies."""
    start: StartPose | None = None


@dataclass(frozen=True)
class Text:
    """Words for people."""

    text: str


@dataclass(frozen=True)
class Thinking:
    """Words that the model writes to itself; not every provider shows them."""

    text: str


@dataclass(frozen=True)
class Call:
    """A tool call that the model proposes. `arguments` is None when the model wrote no JSON object."""

    name: str
    arguments: dict[str, Any] | None


@dataclass(frozen=True)
class Usage:
    """The tokens in the model's context, and the most that it takes; 0 when nobody knows."""

    used: int
    size: int


CutReason = Literal["max_tokens", "refusal"]
"""Why an answer ended early, in ACP's words: it reached the length limit, or the provider withheld the rest."""


@dataclass(frozen=True)
class Cut:
    """The answer is incomplete, so none of its calls may run."""

    reason: CutReason


Part = Text | Thinking | Call | Usage | Cut


class Provider(Protocol):
    """Runs the models whose names begin with its own. A module with this function is a provider."""

    def stream(
        self, model: str, messages: list[Message], tools: list[ToolSchema], situation: Situation
    ) -> AsyncIterator[Part]:
        """Run one inference. `messages` begin with the system message; without `tools` the answer is text alone.

        Calls are whole and come last. Raises `ModelError`.
        """
