"""Starts viser: at the beginning, and anew when it has numbered too many changes. One attempt at a time.

viser's start takes a while, so it has a thread; where it cannot have its port or its loop, it waits for ever, so that
thread is one that nobody waits for at the end. What comes of a start that is no longer wanted is closed.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import copy
import logging
import threading
import time
from typing import TYPE_CHECKING

from backend import telemetry

if TYPE_CHECKING:
    from backend.bridge.scene.stage import Stage
    from backend.bridge.scene.trail import Trail

RENEWAL_SECONDS = 10.0
"""How long the picture may wait for a renewal, which takes a fraction of a second."""
FIRST_PAUSE = 10.0
LONGEST_PAUSE = 600.0
"""s between attempts to renew."""
_LAST_SECONDS = 2.0
"""How long the end of the bridge waits for a start."""

log = logging.getLogger(__name__)


class Renewal:
    """Makes the stages of one robot, and lets time pass after an attempt that failed."""

    def __init__(self, robot_name: str) -> None:
        self._robot_name = robot_name
        self._starting: asyncio.Future[Stage] | None = None  # the latest start, until something came of it
        self._pause = FIRST_PAUSE
        self._not_before = 0.0  # of time.monotonic

    async def first(self) -> Stage:
        """The first stage. Raises whatever viser does."""
        return await self._start(None, [], None)

    async def renewed(self, old: Stage, kept: list[telemetry.AnyMessage]) -> Stage | None:
        """A stage that shows the same and has numbered little; None where `old` has to go on."""
        if self._starting is not None or time.monotonic() < self._not_before:
            return None
        try:
            stage = await self._start(old, kept, RENEWAL_SECONDS)
        except Exception as error:  # whatever it is, an old picture is better than none
            log.error("scene: viser cannot begin anew and goes on as it is: %s", error or type(error).__name__)
            self.failed()
            return None
        self._pause = FIRST_PAUSE
        return stage

    def failed(self) -> None:
        """Try again after a while, and after a longer one the next time."""
        self._not_before = time.monotonic() + self._pause
        self._pause = min(2 * self._pause, LONGEST_PAUSE)

    async def _start(self, old: Stage | None, kept: list[telemetry.AnyMessage], seconds: float | None) -> Stage:
        trail = copy.deepcopy(old.trail) if old is not None else None  # a start that comes late must not add to it
        starting = self._starting = _in_thread(self._robot_name, trail, kept)
        try:
            done, _ = await asyncio.wait([starting], timeout=seconds)
        except asyncio.CancelledError:
            if (await asyncio.wait([starting], timeout=_LAST_SECONDS))[0]:
                _close(starting)
            raise
        if not done:
            starting.add_done_callback(self._came_late)
            raise TimeoutError("its start hangs; another one follows when that is over")
        self._starting = None
        return starting.result()

    def _came_late(self, starting: asyncio.Future[Stage]) -> None:
        self._starting = None
        _close(starting)


def _close(starting: asyncio.Future[Stage]) -> None:
    if starting.exception() is None:
        starting.result().close()


def _in_thread(robot_name: str, trail: Trail | None, kept: list[telemetry.AnyMessage]) -> asyncio.Future[Stage]:
    made: concurrent.futures.Future[Stage] = concurrent.futures.Future()

    def make() -> None:
        try:
            made.set_result(_make_stage(robot_name, trail, kept))
        except BaseException as error:  # raised where it is waited for
            made.set_exception(error)

    threading.Thread(target=make, name="start of viser", daemon=True).start()
    return asyncio.wrap_future(made)


def _make_stage(robot_name: str, trail: Trail | None, kept: list[telemetry.AnyMessage]) -> Stage:
    from backend.bridge.scene.stage import Stage  # viser comes with it, and takes its time

    stage = Stage(robot_name, trail)
    try:
        for message in kept:
            stage.show(message)
    except BaseException:
        stage.close()
        raise
    return stage
