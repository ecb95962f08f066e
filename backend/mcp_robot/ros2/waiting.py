"""Waiting for what the ROS thread changes: it sets plain values, and no event of asyncio could be set from there."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

EVERY = 0.02
"""Seconds between looks."""


async def until(condition: Callable[[], object], limit: float, every: float = EVERY) -> bool:
    """Whether a condition came true within `limit` s.

    A look that comes late counts for two at most: while a busy computer let this process stand, nothing came.
    """
    left = limit
    while not condition():
        if left <= 0:
            return False
        before = time.monotonic()
        await asyncio.sleep(every)
        left -= min(time.monotonic() - before, 2 * every)
    return True
