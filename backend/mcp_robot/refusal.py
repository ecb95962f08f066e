"""Why the robot refuses or ends a motion: a stable code for programs and a sentence for people.

A code never changes its meaning. The sentence tells a person or an LLM what to do next; it must never reveal a file
path, a token or a stack trace. docs/safety.md has the table of all codes, and a test compares the two.
"""

from __future__ import annotations

from typing import Literal

Code = Literal[
    # The request itself is wrong.
    "bad_arguments",
    "not_finite",
    "too_long",
    "empty",
    "unknown_place",
    "outside_map",
    "occupied",
    "keep_out",
    "unreachable",
    # It cannot be done now.
    "stopped",
    "busy",
    "battery_low",
    "too_often",
    "no_sign_of_life",
    # It ended on the way.
    "blocked",
    "too_fast",
    "lost",
    "blind",
    "silent",
    # A part of the robot failed or did not answer.
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
    """A motion or speech ended early because `Robot.halt` or `Robot.hush` was called."""
