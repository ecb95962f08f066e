"""Why the robot did not do what was asked: a stable code and a sentence to act on.

The code is for programs and never changes its meaning; the sentence is for a person or an LLM. Nothing in it may
reveal a path, a token or a stack. docs/safety.md has the table of all codes, and a test holds the two together.
"""

from __future__ import annotations

from typing import Literal

Code = Literal[
    # What was asked for
    "bad_arguments",
    "not_finite",
    "too_long",
    "empty",
    "unknown_place",
    "outside_map",
    "occupied",
    "keep_out",
    "unreachable",
    # When it was asked
    "stopped",
    "busy",
    "battery_low",
    "too_often",
    "no_sign_of_life",
    # On the way
    "blocked",
    "too_fast",
    "lost",
    "blind",
    "silent",
    # What the robot's own parts answer, or do not
    "nav_unavailable",
    "nav_failed",
    "goal_rejected",
    "timeout",
    "no_map",
    "no_camera",
    "no_voice",
]


class Refusal(Exception):
    """The robot refuses, or could not finish. `str()` reads `code: sentence`."""

    def __init__(self, code: Code, sentence: str) -> None:
        super().__init__(f"{code}: {sentence}")
        self.code = code
        self.sentence = sentence


class Halted(Exception):
    """What was under way ended early because `Robot.halt` or `Robot.hush` was called."""
