"""What the ROS thread changes is waited for as long as the limit says, of the time in which anything could change."""

from __future__ import annotations

import asyncio
import math

from backend.mcp_robot.ros2.waiting import until
from tests.mcp_robot.tools.test_watchdog import stand


async def test_what_is_true_already_is_not_waited_for_and_what_never_comes_is_given_up() -> None:
    assert await until(lambda: True, 0.0)
    assert not await until(lambda: False, 0.1)


async def test_it_ends_when_the_condition_comes_true() -> None:
    came = asyncio.Event()
    waiting = asyncio.create_task(until(came.is_set, math.inf))
    await asyncio.sleep(0)
    came.set()
    assert await waiting


async def test_while_this_process_stood_nothing_was_given_up() -> None:
    came = asyncio.Event()
    waiting = asyncio.create_task(until(came.is_set, 0.5))
    await stand(1.0)
    assert not waiting.done()
    came.set()
    assert await waiting
