"""The cameras of those who watch: each sees the whole map at first, and again when its pane changes shape.

A camera that its viewer has moved is never moved again.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, replace

import numpy as np
import viser

from backend.bridge.scene.camera import FIELD_OF_VIEW, Extent, View, fitting

_TYPICAL_ASPECT = 1.3
_NEAR = 0.02
"""m that a camera may be off what it was set to, and still count as not moved."""
_SETTLING_SECONDS = 2.0
"""A page that opens applies the scene's initial view and ours in any order."""


@dataclass
class _Kept:
    """A camera that its viewer has not moved."""

    wanted: View  # where we put it last
    before: View  # where it was then; reports of that are still on their way
    settled: float  # from this time on, another position is the viewer's own choice


class Viewers:
    """Sets each viewer's camera. viser calls it from its own thread; `look_at` comes from another."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._extent: Extent = (-5.0, -5.0, 5.0, 5.0)  # until there is a map
        self._kept: dict[int, _Kept] = {}  # by viewer
        self._lock = threading.Lock()
        server.on_client_connect(self._came)
        server.on_client_disconnect(self._left)
        self._set_initial()

    def look_at(self, extent: Extent) -> None:
        """From now on this part of the map is to be seen."""
        if extent == self._extent:
            return
        self._extent = extent
        self._set_initial()
        for viewer in self._server.get_clients().values():
            self._fit(viewer.camera)

    def _set_initial(self) -> None:
        view = fitting(self._extent, _TYPICAL_ASPECT)
        camera = self._server.initial_camera
        with self._server.atomic():
            camera.position = view.position
            camera.look_at = view.look_at
            camera.fov = FIELD_OF_VIEW

    async def _came(self, viewer: viser.ClientHandle) -> None:
        view = _view(viewer.camera)
        initial = fitting(self._extent, _TYPICAL_ASPECT)
        # A page that was just opened looks at the origin, or has the initial view already. One that
        # connects again stands where its viewer left it.
        if _same(view, initial) or np.allclose(view.look_at, 0.0, atol=_NEAR):
            settled = time.monotonic() + _SETTLING_SECONDS
            with self._lock:
                self._kept[viewer.client_id] = _Kept(initial, view, settled)
        viewer.camera.on_update(self._reported)
        self._fit(viewer.camera)

    async def _left(self, viewer: viser.ClientHandle) -> None:
        with self._lock:
            self._kept.pop(viewer.client_id, None)

    async def _reported(self, camera: viser.CameraHandle) -> None:
        self._fit(camera)

    def _fit(self, camera: viser.CameraHandle) -> None:
        """Show everything, unless the viewer has chosen what to see."""
        viewer = camera.client.client_id
        with self._lock:
            kept = self._kept.get(viewer)
            if kept is None or not camera.image_height:
                return
            reported = _view(camera)
            wanted = fitting(self._extent, camera.image_width / camera.image_height)
            if time.monotonic() > kept.settled and not _same(reported, kept.wanted):
                if not _same(reported, kept.before):
                    del self._kept[viewer]
                return
            if _same(reported, wanted):
                return
            if not _same(wanted, kept.wanted):
                self._kept[viewer] = replace(kept, wanted=wanted, before=kept.wanted)
        with camera.client.atomic():
            camera.position = wanted.position
            camera.look_at = wanted.look_at


def _same(one: View, other: View) -> bool:
    return bool(np.allclose(one.position, other.position, atol=_NEAR))


def _view(camera: viser.CameraHandle) -> View:
    px, py, pz = (float(value) for value in camera.position)
    lx, ly, lz = (float(value) for value in camera.look_at)
    return View((px, py, pz), (lx, ly, lz))
