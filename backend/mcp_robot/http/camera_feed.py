"""The camera as telemetry: one picture after the other while it has viewers, and none while it has none.

A picture is taken once for all viewers. It is sent when it differs from the one before, and now and then when it does
not, so that viewers see that the stream lives. A camera that fails is tried again later and disturbs nothing else.
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
REPEAT_AFTER = 1.0
"""Seconds after which a picture that has not changed is sent again: a viewer must see that it is not an old one."""
RETRY_AFTER = 1.0
"""Seconds after which a camera that failed is tried again."""


class CameraFeed:
    """One robot's camera. `latest` is the newest picture as a telemetry frame, None while there is none."""

    def __init__(
        self,
        pilot: Pilot,
        changed: Callable[[], None],
        *,
        rate: float = RATE,
        repeat_after: float = REPEAT_AFTER,
        retry_after: float = RETRY_AFTER,
    ) -> None:
        """`changed` is called whenever `latest` is another frame; the rest as the constants above."""
        self._interval = 1 / rate
        self._repeat_after = repeat_after
        self._retry_after = retry_after
        self._pilot = pilot
        self._changed = changed
        self._viewers: set[object] = set()
        self._task: asyncio.Task[None] | None = None
        self.latest: bytes | None = None

    def watch(self, viewer: object) -> None:
        """Send pictures to this viewer from now on. Calling it twice is harmless."""
        self._viewers.add(viewer)
        if self._task is None:
            self._task = asyncio.create_task(self._run(), name="camera feed")

    def unwatch(self, viewer: object) -> None:
        """This viewer wants no more pictures. With the last viewer the camera rests."""
        self._viewers.discard(viewer)
        if not self._viewers and self._task is not None:
            self._task.cancel()
            self._task = self.latest = None

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        failing = False
        sent, repeat_at = b"", 0.0  # the latest picture that was sent, and when it is sent again
        while True:
            due = loop.time() + self._interval
            try:
                time = self._pilot.robot.clock()
                picture = await self._pilot.photo()
            except Exception as error:  # from a driver or a decoder: it must not end the stream
                if not failing:
                    why = error.code if isinstance(error, Refusal) else type(error).__name__
                    log.warning("The camera shows nothing (%s); trying again every %g s.", why, self._retry_after)
                failing = True
                sent, self.latest = b"", None
                due = loop.time() + self._retry_after
            else:
                failing = False
                if picture.jpeg != sent or loop.time() >= repeat_at:
                    sent, repeat_at = picture.jpeg, loop.time() + self._repeat_after
                    self.latest = telemetry.encode(
                        telemetry.Picture(time, picture.pose, picture.width, picture.height, picture.jpeg)
                    )
                    self._changed()
            await asyncio.sleep(max(0.0, due - loop.time()))
