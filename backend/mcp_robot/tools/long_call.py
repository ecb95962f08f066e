"""A call that acts and therefore lasts: its client receives progress, and has to stay there.

Progress is reported at most twice a second of wall time. When the client's HTTP connection is gone, or the watchdog
receives no sign of life, the call ends, and its motion with it: older versions of the MCP protocol do not cancel a call
when its connection ends. Nothing here moves or halts the robot; the motion ends because its task does.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import AsyncIterator

from mcp.server.mcpserver import Context

from backend.config import Limits
from backend.mcp_robot.motion.pilot import Pilot
from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.robot import Remaining
from backend.mcp_robot.tools import watchdog

CLIENT_GONE = "robot-acp.client-gone"
"""ASGI scope key of an `asyncio.Event` that the HTTP room sets when the client of a request has hung up."""
INTERVAL = 0.5
"""Seconds between two progress reports."""
FIRST_REPORT = 0.05
"""Seconds between two checks whether the motion has begun."""


class ClientGone(Refusal):
    """The client that owns the call has left; nobody reads this."""

    def __init__(self) -> None:
        super().__init__("stopped", "The client that asked for this is gone.")


@contextlib.asynccontextmanager
async def long_call(
    context: Context, callers: watchdog.Callers, limits: Limits, moving: Pilot | None = None
) -> AsyncIterator[None]:
    """Report the motion of `moving` while inside. Raises `Refusal` before anything begins when the client can give no
    sign of life, and inside when the client is gone or silent."""
    watchdog.admit(context, limits)
    try:
        async with asyncio.TaskGroup() as group:
            tasks = [
                group.create_task(_until_hung_up(context)),
                group.create_task(_until_silent(context, callers, limits, moving)),
            ]
            if moving:
                tasks.append(group.create_task(_report(context, moving)))
            yield
            for task in tasks:
                task.cancel()
    except BaseExceptionGroup as several:
        raise _first(several) from None


def _first(several: BaseExceptionGroup[BaseException]) -> BaseException:
    """The one exception that matters: a task group wraps even a single one."""
    inner = several.exceptions[0]
    return _first(inner) if isinstance(inner, BaseExceptionGroup) else inner


async def _report(context: Context, pilot: Pilot) -> None:
    longest = 0.0  # the most seconds that were ever left: the whole of the motion
    while True:
        left = pilot.robot.remaining
        if left:
            longest = max(longest, left.seconds)
            done = 1.0 - left.seconds / longest if longest else 1.0
            await context.report_progress(done, 1.0, message(left))
        await asyncio.sleep(INTERVAL if left else FIRST_REPORT)


async def _until_silent(context: Context, callers: watchdog.Callers, limits: Limits, moving: Pilot | None) -> None:
    try:
        await watchdog.watch(context, callers, limits)
    except Refusal as silence:
        if moving:
            moving.halted_by(silence)
        raise


async def _until_hung_up(context: Context) -> None:
    """Raises `ClientGone` when the HTTP client hangs up. Over stdio there is no such event: the process ends."""
    request = context.request_context.request
    gone = getattr(request, "scope", {}).get(CLIENT_GONE)
    if isinstance(gone, asyncio.Event):
        await gone.wait()
        raise ClientGone


def message(left: Remaining) -> str:
    """What is left of a motion, in words for people."""
    seconds = max(1, math.ceil(left.seconds))
    if left.angle:
        return f"{math.degrees(left.angle):.0f}° to go, about {seconds} s"
    return f"{left.distance:.1f} m to go, about {seconds} s"
