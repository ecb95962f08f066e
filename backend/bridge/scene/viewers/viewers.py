"""The viewers of the scene: for each the camera of its page, and the control beside the page that chooses the view.

A viewer is identified by the id that its page has made up and by the name of its login, so nobody can reach another
person's. A viewer is forgotten when its page and its control have disconnected.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from backend.bridge.scene import viser_internals
from backend.bridge.scene.conflating_queue import ConflatingQueue
from backend.bridge.scene.drawing.camera_views import View
from backend.bridge.scene.drawing.shapes import Extent
from backend.bridge.scene.viewers import picking
from backend.bridge.scene.viewers.viewer_camera import CameraReport, ViewChoice, ViewerCamera
from backend.telemetry import Place, Pose

ViewerKey = tuple[str, str]
"""The name of the login, and the id that the page has made up."""

PageQueue = ConflatingQueue[bytes]
"""Frames for a viewer's page."""
ControlQueue = ConflatingQueue[dict[str, Any]]
"""Messages for a viewer's control."""


class Viewer:
    """One viewer. Of two pages or two controls with one id, the newer one counts."""

    def __init__(self, camera: ViewerCamera) -> None:
        self._camera = camera
        self._page: PageQueue | None = None
        self._control: ControlQueue | None = None
        self._on_replaced: Callable[[], None]  # set with the control
        self._is_picking = False
        self._reported_view: str | None = None  # the view that was last sent to the control

    def page_opened(self, page: PageQueue) -> None:
        """A page has connected."""
        self._page = page
        self._camera.page_closed()
        if self._is_picking:
            page.put("clicks", viser_internals.click_frame(True))

    def page_closed(self, page: PageQueue) -> None:
        """A page has disconnected."""
        if self._page is page:
            self._page = None
            self._camera.page_closed()

    def control_opened(self, control: ControlQueue, on_replaced: Callable[[], None]) -> None:
        """A control has connected; `on_replaced` is called when another one takes its place."""
        if self._control is not None:
            self._on_replaced()
        self._control, self._on_replaced, self._reported_view = control, on_replaced, None
        self.set_picking(False)
        self._report_view()

    def control_closed(self, control: ControlQueue) -> None:
        """A control has disconnected."""
        if self._control is control:
            self._control = None
            self.set_picking(False)

    def choose_view(self, view: ViewChoice) -> None:
        """The control asks for a view. It is answered also where that changes nothing."""
        self._move_camera(self._camera.choose(view, time.monotonic()))
        self._reported_view = None
        self._report_view()

    def set_picking(self, wanted: bool) -> None:
        """Whether clicks on the floor are reported to the control."""
        if wanted != self._is_picking:
            self._is_picking = wanted
            if self._page is not None:
                self._page.put("clicks", viser_internals.click_frame(wanted))

    def camera_reported(self, page: PageQueue, report: CameraReport) -> None:
        """A page reports where its camera stands."""
        if self._page is page:
            self._move_camera(self._camera.reported(report, time.monotonic()))
            self._report_view()

    def camera_taken(self) -> None:
        """The viewer has moved the camera by hand."""
        self._camera.moved_by_hand()
        self._report_view()

    def clicked(self, page: PageQueue, click: viser_internals.Click, extent: Extent, places: list[Place]) -> None:
        """A page reports a click."""
        if self._page is not page or self._control is None or not self._is_picking:
            return
        if (point := picking.floor_point(click, extent)) is not None:
            x, y = (round(value, 3) for value in point)
            self._control.put("picked", {"picked": {"x": x, "y": y, "place": picking.place_at(point, places)}})

    def map_changed(self, extent: Extent) -> None:
        """The map covers `extent` from now on."""
        self._move_camera(self._camera.map_changed(extent))
        self._report_view()

    def robot_moved(self, pose: Pose, now: float) -> None:
        """The robot is at `pose`."""
        self._move_camera(self._camera.robot_moved(pose, now))

    def _move_camera(self, view: View | None) -> None:
        if view is not None and self._page is not None:
            self._page.put("camera", viser_internals.camera_frame(view.position, view.look_at))

    def _report_view(self) -> None:
        if self._control is not None and self._reported_view != self._camera.view:
            self._reported_view = self._camera.view
            self._control.put("view", {"view": self._camera.view})


class Viewers:
    """All viewers, and the map and the robot that they look at."""

    def __init__(self) -> None:
        self._by_key: dict[ViewerKey, Viewer] = {}
        self._connections: dict[ViewerKey, int] = {}  # pages and controls of each viewer
        self._extent: Extent = (-5.0, -5.0, 5.0, 5.0)  # until there is a map
        self._places: list[Place] = []
        self._robot: Pose | None = None

    @contextmanager
    def viewer(self, key: ViewerKey) -> Iterator[Viewer]:
        """The viewer with that key, kept while anything is connected for it."""
        viewer = self._by_key.setdefault(key, Viewer(ViewerCamera(self._extent, self._robot)))
        self._connections[key] = self._connections.get(key, 0) + 1
        try:
            yield viewer
        finally:
            self._connections[key] -= 1
            if not self._connections[key]:
                del self._connections[key], self._by_key[key]

    def camera_taken(self, key: ViewerKey) -> None:
        """The viewer with that key has moved the camera by hand; nothing happens where there is no such viewer."""
        if (viewer := self._by_key.get(key)) is not None:
            viewer.camera_taken()

    def clicked(self, viewer: Viewer, page: PageQueue, click: viser_internals.Click) -> None:
        """A viewer's page reports a click."""
        viewer.clicked(page, click, self._extent, self._places)

    def map_changed(self, extent: Extent, places: list[Place]) -> None:
        """The map covers `extent` and has these places from now on."""
        self._extent, self._places = extent, places
        for viewer in self._by_key.values():
            viewer.map_changed(extent)

    def robot_moved(self, pose: Pose) -> None:
        """The robot is at `pose`."""
        self._robot, now = pose, time.monotonic()
        for viewer in self._by_key.values():
            viewer.robot_moved(pose, now)
