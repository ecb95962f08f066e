"""Waiting for what the ROS thread changes: it sets plain values, and no event of asyncio could be set from there."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

EVERY = 0.02
"""Seconds between looks."""


async def until(condition: Callable[[], object], limit: float, every: float = EVERY) -> bool:
    """Whether a condition came true within `limit` s."""
    deadline = time.monotonic() + limit
    while True:
        if condition():
            return True
        if time.monotonic() >= deadline:
            return False
        await asyncio.sleep(every)
