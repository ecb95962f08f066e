"""Loops that end together: a relay has one for each direction, and neither may outlive the other."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


async def first_of(*loops: Coroutine[Any, Any, T]) -> T:
    """Run all until the first one ends, cancel the others, and return (or raise) what that one did."""
    tasks = [asyncio.ensure_future(loop) for loop in loops]
    try:
        ended, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    return next(task for task in tasks if task in ended).result()
