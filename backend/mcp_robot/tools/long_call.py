"""What goes on beside a call that acts: progress is told to its client, at most twice a second of wall time, and its
client has to be there.

When the HTTP connection is gone, or the watchdog hears nothing of the client, the call ends, and its motion with it:
older protocol versions do not cancel a call by that.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import AsyncIterator

from mcp.server.mcpserver import Context

from backend.config import Limits
from backend.mcp_robot.http.access import CLIENT_GONE
from backend.mcp_robot.motion.pilot import Pilot
from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.robot import Remaining
from backend.mcp_robot.tools import watchdog

INTERVAL = 0.5


class ClientGone(Refusal):
    """The client that owns the call has left; nobody reads this."""

    def __init__(self) -> None:
        super().__init__("stopped", "The client that asked for this is gone.")


@contextlib.asynccontextmanager
async def accompanied(
    context: Context, callers: watchdog.Callers, limits: Limits, moving: Pilot | None = None
) -> AsyncIterator[None]:
    """Report the motion of `moving` while inside; leaves early, by an exception, when the client is gone or silent."""
    watchdog.admit(context, limits)
    try:
        async with asyncio.TaskGroup() as group:
            heard = group.create_task(_listen(context, callers, limits, moving))
            tasks = [group.create_task(_watch(context)), heard]
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
    whole = 0.0
    while True:
        left = pilot.robot.remaining
        if left:
            whole = max(whole, left.seconds)
            done = 1.0 - left.seconds / whole if whole else 1.0
            await context.report_progress(done, 1.0, message(left))
        await asyncio.sleep(INTERVAL if left else 0.05)


async def _listen(context: Context, callers: watchdog.Callers, limits: Limits, moving: Pilot | None) -> None:
    try:
        await watchdog.watch(context, callers, limits)
    except Refusal as silence:
        if moving:
            moving.halted_by(silence)
        raise


async def _watch(context: Context) -> None:
    request = context.request_context.request
    gone = getattr(request, "scope", {}).get(CLIENT_GONE)
    if isinstance(gone, asyncio.Event):
        await gone.wait()
        raise ClientGone


def message(left: Remaining) -> str:
    """What is left, for people."""
    seconds = max(1, math.ceil(left.seconds))
    if left.angle:
        return f"{math.degrees(left.angle):.0f}° to go, about {seconds} s"
    return f"{left.distance:.1f} m to go, about {seconds} s"
