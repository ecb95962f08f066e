"""Waits for conditions that the ROS thread changes. It writes plain values, so they are polled from the event loop."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass

EVERY = 0.02
"""Seconds between two checks of a condition."""


@dataclass(frozen=True)
class Waits:
    """How long, in s, the adapter waits for the parts of the robot."""

    start: float = 8.0
    """The start waits so long for the robot's parts; without them the server answers, and says what is missing."""
    rest: float = 3.0
    """A motion's end waits so long for odometry to say that the robot stands."""
    silence: float = 10.0
    """Without feedback for so long an action has failed. Nav2 gives some many times a second."""
    battery: float = 60.0
    """After so long a silence the charge counts as unknown."""
    halted_goal: float = 3.0
    """A halted goal may take so long to end before the log reports it, and a new motion is refused."""


async def until(condition: Callable[[], object], limit: float, every: float = EVERY) -> bool:
    """Check a condition every `every` s; returns whether it came true within `limit` s.

    A check that comes late counts for two at most: while a busy computer suspends this process, nothing can arrive.
    """
    left = limit
    while not condition():
        if left <= 0:
            return False
        before = time.monotonic()
        await asyncio.sleep(every)
        left -= min(time.monotonic() - before, 2 * every)
    return True
