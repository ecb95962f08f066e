"""Starts viser: once at the beginning, and again when it has numbered too many changes. One start at a time.

A start takes a second, so it runs in a thread of its own. A start that hangs (viser waits for ever where it gets no
port) must block neither the scene nor the end of the process: that thread is a daemon, and a scene graph that is ready
too late is closed.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import copy
import logging
import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from backend import telemetry

if TYPE_CHECKING:
    from backend.bridge.scene.drawing.scene_graph import SceneGraph
    from backend.bridge.scene.drawing.trail import Trail

RESTART_SECONDS = 10.0
"""The scene stands still during a restart, for this long at most; a restart takes a fraction of a second."""
_SHUTDOWN_SECONDS = 2.0
"""How long the end of the bridge waits for a start."""

log = logging.getLogger(__name__)


class Backoff:
    """When to try again after failed attempts: `first` s later, then twice as long each time, up to `longest` s.

    Times are in s of any clock that never goes back.
    """

    def __init__(self, first: float = 10.0, longest: float = 600.0) -> None:
        self._first = first
        self._longest = longest
        self._pause = first
        self.retry_at = -math.inf

    def failed(self, now: float) -> None:
        """An attempt has failed."""
        self.retry_at = now + self._pause
        self._pause = min(2 * self._pause, self._longest)

    def succeeded(self) -> None:
        """An attempt has succeeded."""
        self._pause = self._first
        self.retry_at = -math.inf


def build_scene_graph(robot_name: str, trail: Trail | None, messages: Sequence[telemetry.AnyMessage]) -> SceneGraph:
    """A new viser server that shows `messages`; `trail` is where the robot has been. Raises whatever viser raises."""
    from backend.bridge.scene.drawing.scene_graph import SceneGraph  # imports viser, which takes a second

    graph = SceneGraph(robot_name, trail)
    try:
        for message in messages:
            graph.draw(message)
    except BaseException:
        graph.close()
        raise
    return graph


class ViserStarter:
    """Builds the scene graphs of one robot, one after the other. `restart_seconds` limits a restart."""

    def __init__(
        self,
        robot_name: str,
        *,
        build: Callable[[str, Trail | None, Sequence[telemetry.AnyMessage]], SceneGraph] = build_scene_graph,
        restart_seconds: float = RESTART_SECONDS,
        backoff: Backoff | None = None,
    ) -> None:
        self._robot_name = robot_name
        self._build = build
        self._restart_seconds = restart_seconds
        self._backoff = backoff or Backoff()
        self._pending: asyncio.Future[SceneGraph] | None = None  # a start that has neither succeeded nor failed yet

    async def start(self) -> SceneGraph:
        """The first scene graph. Raises whatever viser raises."""
        return await self._start(None, [], None)

    async def restart(self, old: SceneGraph, messages: Sequence[telemetry.AnyMessage]) -> SceneGraph | None:
        """A scene graph that shows `messages` and the trail of `old`; None where `old` has to go on."""
        if self._pending is not None or time.monotonic() < self._backoff.retry_at:
            return None
        trail = copy.deepcopy(old.trail)  # a start that comes too late must not change the trail of `old`
        try:
            graph = await self._start(trail, messages, self._restart_seconds)
        except Exception as error:  # an old picture is better than none, whatever the error
            log.error("scene: viser cannot restart and goes on as it is: %s", error or type(error).__name__)
            self._backoff.failed(time.monotonic())
            return None
        self._backoff.succeeded()
        return graph

    async def _start(
        self, trail: Trail | None, messages: Sequence[telemetry.AnyMessage], seconds: float | None
    ) -> SceneGraph:
        pending = self._pending = _in_daemon_thread(lambda: self._build(self._robot_name, trail, messages))
        try:
            done, _ = await asyncio.wait([pending], timeout=seconds)
        except asyncio.CancelledError:
            if (await asyncio.wait([pending], timeout=_SHUTDOWN_SECONDS))[0]:
                _close(pending)
            raise
        if not done:
            pending.add_done_callback(self._discard)
            raise TimeoutError("its start hangs; the next one follows when that has ended")
        self._pending = None
        return pending.result()

    def _discard(self, pending: asyncio.Future[SceneGraph]) -> None:
        self._pending = None
        _close(pending)


def _close(pending: asyncio.Future[SceneGraph]) -> None:
    if pending.exception() is None:
        pending.result().close()


def _in_daemon_thread(build: Callable[[], SceneGraph]) -> asyncio.Future[SceneGraph]:
    """Run `build` in a thread that does not keep the process alive, as those of `asyncio.to_thread` would."""
    built: concurrent.futures.Future[SceneGraph] = concurrent.futures.Future()

    def run() -> None:
        try:
            built.set_result(build())
        except BaseException as error:  # raised again where the future is awaited
            built.set_exception(error)

    threading.Thread(target=run, name="start of viser", daemon=True).start()
    return asyncio.wrap_future(built)
