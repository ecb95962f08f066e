"""The scene as one part of the bridge: it starts beside the pages, never before them, and follows the robot."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING

from backend import telemetry
from backend.bridge.scene.feed import Feed

if TYPE_CHECKING:
    from backend.bridge.scene.stage import Stage

log = logging.getLogger(__name__)


class SceneDownError(Exception):
    """The scene cannot be shown; the text is for the person in front of its pane."""


class Scene:
    """viser and the telemetry that feeds it. `run` keeps it going; everything else may be asked meanwhile."""

    def __init__(self, robot_name: str, telemetry_url: str, secret: bytes) -> None:
        self._robot_name = robot_name
        self._feed = Feed(telemetry_url, secret, self._show, self._lost)
        self._stage: Stage | None = None  # set once viser runs
        self._started = asyncio.Event()  # set once viser runs, or has failed to
        self._watching = 0

    async def run(self) -> None:
        """Start viser in a thread, as its import and start take a while, and feed it until cancelled."""
        starting = asyncio.ensure_future(asyncio.to_thread(_make_stage, self._robot_name))
        try:
            self._stage = await asyncio.shield(starting)
        except asyncio.CancelledError:
            (await starting).close()  # a thread cannot be cancelled
            raise
        except Exception:
            log.exception("the scene cannot be started; all else goes on without it")
            return
        finally:
            self._started.set()
        try:
            await self._feed.run()
        finally:
            self._stage.close()

    async def port(self) -> int:
        """Where viser listens on loopback, once it does. Raises `SceneDownError`."""
        await self._started.wait()
        if self._stage is None:
            raise SceneDownError("The scene could not be started. The log of the bridge says why.")
        return self._stage.port

    def viewer_came(self) -> None:
        """Somebody looks: ask the robot for all there is to see."""
        self._watching += 1
        self._feed.watch(True)

    def viewer_left(self) -> None:
        """Somebody looks no more."""
        self._watching -= 1
        self._feed.watch(self._watching > 0)

    async def _show(self, message: telemetry.AnyMessage) -> None:
        assert self._stage is not None  # noqa: S101 - the feed runs only while there is a stage
        if isinstance(message, telemetry.Map):
            await asyncio.to_thread(self._stage.show, message)  # a floor to paint: too long for the event loop
        else:
            self._stage.show(message)

    def _lost(self) -> None:
        if self._stage is not None:
            self._stage.lost()


def _make_stage(robot_name: str) -> Stage:
    from backend.bridge.scene.stage import Stage  # viser comes with it, and takes its time

    return Stage(robot_name)
