"""Why the robot did not do what was asked: a stable code and a sentence to act on.

The code is for programs and never changes its meaning; the sentence is for a person or an LLM. Nothing in it may
reveal a path, a token or a stack.
"""

from __future__ import annotations

from typing import Literal

Code = Literal[
    "outside_map",
    "occupied",
    "unreachable",
    "not_finite",
    "stopped",
    "busy",
    "battery_low",
    "too_long",
    "empty",
    "unknown_place",
    "blocked",
    "bad_arguments",
]


class Refusal(Exception):
    """The robot refuses, or could not finish. `str()` reads `code: sentence`."""

    def __init__(self, code: Code, sentence: str) -> None:
        super().__init__(f"{code}: {sentence}")
        self.code = code
        self.sentence = sentence


class Halted(Exception):
    """What was under way ended early because `Robot.halt` or `Robot.hush` was called."""
