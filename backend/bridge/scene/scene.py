"""The scene as one part of the bridge: it starts viser, feeds it with telemetry, and knows who watches.

The web pages must never wait for it: it starts beside them, and its failure leaves everything else running.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from backend import telemetry
from backend.bridge.scene.conflating_queue import ConflatingQueue
from backend.bridge.scene.telemetry_feed import TelemetryFeed
from backend.bridge.scene.viewers.viewers import Viewers
from backend.bridge.scene.viser_starter import ViserStarter
from backend.robot_server import RobotServerClient

if TYPE_CHECKING:
    from backend.bridge.scene.drawing.scene_graph import SceneGraph

log = logging.getLogger(__name__)


class SceneUnavailableError(Exception):
    """The scene cannot be shown; the text is for the person in front of its pane."""


@dataclass(frozen=True)
class RestartLimits:
    """After how many changes viser restarts, while nobody watches and while somebody does.

    viser numbers every change and never forgets a number. A new page waits until viser has walked through all of them:
    a quarter of a second for two million. A restart disconnects the pages for about a second.
    """

    unwatched: int = 500_000
    watched: int = 2_000_000


class Scene:
    """viser and the telemetry that it shows. `run` keeps it going; the other methods may be called meanwhile."""

    def __init__(
        self,
        robot_name: str,
        robot: RobotServerClient,
        *,
        starter: ViserStarter | None = None,
        limits: RestartLimits | None = None,
    ) -> None:
        self.viewers = Viewers()
        self._starter = starter or ViserStarter(robot_name)
        self._limits = limits or RestartLimits()
        self._feed = TelemetryFeed(robot, self._on_message, self._on_disconnect)
        self._graph: SceneGraph | None = None  # set once viser runs
        self._started = asyncio.Event()  # set once viser runs, or has failed to start
        self._watching = 0  # how many pages show the scene
        self._camera_queues: set[ConflatingQueue[bytes]] = set()  # of those who watch the robot's camera
        self._current: dict[type, telemetry.AnyMessage] = {}  # the newest of each kind that is true until the next one

    async def run(self) -> None:
        """Start viser and feed it until cancelled."""
        try:
            self._graph = await self._starter.start()
        except Exception:
            log.exception("the scene cannot be started; all else goes on without it")
            return
        finally:
            self._started.set()
        try:
            await self._feed.run()
        finally:
            self._graph.close()

    async def port(self) -> int:
        """The port of viser on loopback, once viser runs. Raises `SceneUnavailableError`."""
        await self._started.wait()
        if self._graph is None:
            raise SceneUnavailableError("The scene could not be started. The log of the bridge says why.")
        return self._graph.port

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Count one more watching page within this context: the robot is asked for all that the scene can show."""
        self._watching += 1
        self._update_subscription()
        try:
            yield
        finally:
            self._watching -= 1
            self._update_subscription()

    @contextmanager
    def pictures(self) -> Iterator[ConflatingQueue[bytes]]:
        """The queue of the robot's camera: within this context it receives each picture as a JPEG."""
        queue = ConflatingQueue[bytes]()
        self._camera_queues.add(queue)
        self._update_subscription()
        try:
            yield queue
        finally:
            self._camera_queues.remove(queue)
            self._update_subscription()

    def _update_subscription(self) -> None:
        self._feed.set_watched(scene=self._watching > 0, camera=bool(self._camera_queues))

    async def _on_message(self, message: telemetry.AnyMessage) -> None:
        assert self._graph is not None  # noqa: S101 - the feed runs only while there is a scene graph
        match message:
            case telemetry.State():
                self.viewers.robot_moved(message.pose)
                if not self._camera_queues:
                    self._graph.hide_camera_view()
            case telemetry.Picture():
                if not self._camera_queues:
                    return  # it was on its way when the last viewer left
                for queue in self._camera_queues:
                    queue.put("picture", message.jpeg)
        if isinstance(message, telemetry.Map):
            await self._draw_map(message)
            self.viewers.map_changed(self._graph.extent, message.places)
        else:
            self._graph.draw(message)
        if isinstance(message, telemetry.Map | telemetry.Path | telemetry.State | telemetry.Hello):
            self._current[type(message)] = message
        if self._graph.change_count > (self._limits.watched if self._watching else self._limits.unwatched):
            await self._restart()

    async def _draw_map(self, grid: telemetry.Map) -> None:
        """Draw a map in a thread, as it takes too long for the event loop."""
        assert self._graph is not None  # noqa: S101 - see above
        drawing = asyncio.ensure_future(asyncio.to_thread(self._graph.draw, grid))
        try:
            await asyncio.shield(drawing)
        except asyncio.CancelledError:
            await asyncio.wait([drawing])  # a thread cannot be cancelled, and the scene graph is closed after this
            raise

    async def _restart(self) -> None:
        """Let viser number its changes from 0 again. Pages lose their connection and find the same picture again."""
        assert self._graph is not None  # noqa: S101 - see above
        old = self._graph
        if (new := await self._starter.restart(old, list(self._current.values()))) is not None:
            self._graph = new
            await asyncio.to_thread(old.close)

    def _on_disconnect(self) -> None:
        if self._graph is not None:
            self._graph.show_disconnected()
