"""The scene as one part of the bridge: it starts beside the pages, never before them, and follows the robot."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from backend import telemetry
from backend.bridge.scene.feed import Feed
from backend.bridge.scene.latest import Latest
from backend.bridge.scene.renewal import Renewal
from backend.bridge.scene.viewers import Viewers

if TYPE_CHECKING:
    from backend.bridge.scene.stage import Stage

RENEW_UNSEEN = 500_000
RENEW_SEEN = 2_000_000
"""Changes after which viser begins anew, while nobody looks and while somebody does. A new viewer waits for a walk
through all of them, a quarter of a second for two millions; pages connect again within a second."""

log = logging.getLogger(__name__)


class SceneDownError(Exception):
    """The scene cannot be shown; the text is for the person in front of its pane."""


class Scene:
    """viser and the telemetry that feeds it. `run` keeps it going; everything else may be asked meanwhile."""

    def __init__(self, robot_name: str, telemetry_url: str, secret: bytes) -> None:
        self.viewers = Viewers()
        self._renewal = Renewal(robot_name)
        self._feed = Feed(telemetry_url, secret, self._show, self._lost)
        self._stage: Stage | None = None  # set once viser runs
        self._started = asyncio.Event()  # set once viser runs, or has failed to
        self._watching = 0
        self._cameras: set[Latest[bytes]] = set()  # of those who look through the robot's camera
        self._shown: dict[type, telemetry.AnyMessage] = {}  # the last of each kind that stays true until the next

    async def run(self) -> None:
        """Start viser in a thread, as its import and start take a while, and feed it until cancelled."""
        try:
            self._stage = await self._renewal.first()
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

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Somebody looks meanwhile: the robot is asked for all there is to see."""
        self._watching += 1
        self._ask()
        try:
            yield
        finally:
            self._watching -= 1
            self._ask()

    @contextmanager
    def pictures(self) -> Iterator[Latest[bytes]]:
        """Somebody looks through the robot's camera meanwhile, and gets JPEG pictures."""
        looker = Latest[bytes]()
        self._cameras.add(looker)
        self._ask()
        try:
            yield looker
        finally:
            self._cameras.remove(looker)
            self._ask()

    def _ask(self) -> None:
        self._feed.watch(scene=self._watching > 0, camera=bool(self._cameras))

    async def _show(self, message: telemetry.AnyMessage) -> None:
        assert self._stage is not None  # noqa: S101 - the feed runs only while there is a stage
        match message:
            case telemetry.State():
                self.viewers.robot_at(message.pose)
                if not self._cameras:
                    self._stage.camera_off()
            case telemetry.Picture():
                if not self._cameras:
                    return  # it was on its way when the last one looked away
                for looker in self._cameras:
                    looker.put("picture", message.jpeg)
        if isinstance(message, telemetry.Map):
            await self._paint(message)
            self.viewers.look_at(self._stage.extent, message.places)
        else:
            self._stage.show(message)
        if isinstance(message, telemetry.Map | telemetry.Path | telemetry.State | telemetry.Hello):
            self._shown[type(message)] = message
        if self._stage.changes > (RENEW_SEEN if self._watching else RENEW_UNSEEN):
            await self._renew()

    async def _paint(self, grid: telemetry.Map) -> None:
        """Draw a map, in a thread: too long for the event loop."""
        assert self._stage is not None  # noqa: S101 - see above
        painting = asyncio.ensure_future(asyncio.to_thread(self._stage.show, grid))
        try:
            await asyncio.shield(painting)
        except asyncio.CancelledError:
            await asyncio.wait([painting])  # a thread cannot be cancelled, and the stage closes after it
            raise

    async def _renew(self) -> None:
        """Have viser number its changes from nought again. Pages lose their connection, and come back to the same."""
        assert self._stage is not None  # noqa: S101 - see above
        old = self._stage
        if (new := await self._renewal.renewed(old, list(self._shown.values()))) is not None:
            self._stage = new
            await asyncio.to_thread(old.close)

    def _lost(self) -> None:
        if self._stage is not None:
            self._stage.lost()
