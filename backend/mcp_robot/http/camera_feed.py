"""The camera as telemetry: one picture after the other while somebody looks, and none while nobody does.

A picture is taken once for all who look, and told only when it is another one, or to say that nothing has changed. A
camera that fails is asked again later; it never disturbs anything else.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from backend import telemetry
from backend.mcp_robot.motion.pilot import Pilot
from backend.mcp_robot.refusal import Refusal

log = logging.getLogger(__name__)

RATE = 5.0
"""Pictures a second, at most."""
STILL = 1.0
"""Seconds after which the same picture is told again: whoever looks must see that it is not an old one."""
RETRY = 1.0
"""Seconds after which a camera that failed is asked again."""


class CameraFeed:
    """One robot's camera. `latest` is the newest picture as a telemetry frame, None while there is none."""

    def __init__(self, pilot: Pilot, changed: Callable[[], None]) -> None:
        """`changed` is called whenever `latest` is another one."""
        self._pilot = pilot
        self._changed = changed
        self._lookers: set[object] = set()
        self._task: asyncio.Task[None] | None = None
        self.latest: bytes | None = None

    def look(self, who: object) -> None:
        """Somebody looks from now on; doing it twice is harmless."""
        self._lookers.add(who)
        if self._task is None:
            self._task = asyncio.create_task(self._run(), name="camera feed")

    def look_away(self, who: object) -> None:
        """Somebody does not look any more; with the last one the pictures end."""
        self._lookers.discard(who)
        if not self._lookers and self._task is not None:
            self._task.cancel()
            self._task = self.latest = None

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        failing = False
        told, again = b"", 0.0  # the last picture, and when it is due again
        while True:
            due = loop.time() + 1 / RATE
            try:
                time = self._pilot.robot.clock()
                picture = await self._pilot.photo()
            except Exception as error:  # a driver's, a decoder's: it must not end what others look at
                if not failing:
                    why = error.code if isinstance(error, Refusal) else type(error).__name__
                    log.warning("The camera shows nothing (%s); trying again every %g s.", why, RETRY)
                failing = True
                told, self.latest = b"", None
                due = loop.time() + RETRY
            else:
                failing = False
                if picture.jpeg != told or loop.time() >= again:
                    told, again = picture.jpeg, loop.time() + STILL
                    self.latest = telemetry.encode(
                        telemetry.Picture(time, picture.pose, picture.width, picture.height, picture.jpeg)
                    )
                    self._changed()
            await asyncio.sleep(max(0.0, due - loop.time()))
