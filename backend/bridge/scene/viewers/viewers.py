"""Those who watch: for each the camera of its page, and the control beside it that says what to look at.

A viewer is known by the id that its page made up, and by who is logged in: nobody can reach another person's. It is
forgotten when page and control are gone.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from backend.bridge.scene import picking, viser_wire
from backend.bridge.scene.camera import View
from backend.bridge.scene.eye import Choice, Eye, Report
from backend.bridge.scene.latest import Latest
from backend.bridge.scene.shapes import Extent
from backend.telemetry import Place, Pose

Key = tuple[str, str]
"""Who is logged in, and the id that the page made up."""

Page = Latest[bytes]
"""Frames for a viewer's page."""
Control = Latest[dict[str, Any]]
"""Messages for a viewer's control."""


class Viewer:
    """One viewer. Of two pages or two controls with one id the newer counts."""

    def __init__(self, eye: Eye) -> None:
        self.eye = eye
        self.page: Page | None = None
        self.control: Control | None = None
        self._replaced: Callable[[], None]  # set with the control
        self._picking = False
        self._said: str | None = None  # the view that the control knows of

    def page_opened(self, page: Page) -> None:
        """Its page is connected."""
        self.page = page
        self.eye.closed()
        if self._picking:
            page.put("clicks", viser_wire.clicks(True))

    def page_closed(self, page: Page) -> None:
        """A page of it is gone."""
        if self.page is page:
            self.page = None
            self.eye.closed()

    def control_opened(self, control: Control, replaced: Callable[[], None]) -> None:
        """Its control is connected; `replaced` is called when another one takes its place."""
        if self.control is not None:
            self._replaced()
        self.control, self._replaced, self._said = control, replaced, None
        self.pick(False)
        self._tell()

    def control_closed(self, control: Control) -> None:
        """A control of it is gone."""
        if self.control is control:
            self.control = None
            self.pick(False)

    def choose(self, view: Choice) -> None:
        """The control asks for a view."""
        self._put(self.eye.choose(view, time.monotonic()))
        self._said = None  # an answer to each wish, also to one that changes nothing
        self._tell()

    def pick(self, wanted: bool) -> None:
        """Whether clicks on the floor are to be told."""
        if wanted != self._picking:
            self._picking = wanted
            if self.page is not None:
                self.page.put("clicks", viser_wire.clicks(wanted))

    def reported(self, page: Page, report: Report) -> None:
        """A page of it says where its camera stands."""
        if self.page is page:
            self._put(self.eye.reported(report, time.monotonic()))
            self._tell()

    def moved(self) -> None:
        """Its viewer has taken the camera in hand."""
        self.eye.moved()
        self._tell()

    def clicked(self, page: Page, click: viser_wire.Click, extent: Extent, places: list[Place]) -> None:
        """A page of it tells of a click."""
        if self.page is not page or self.control is None or not self._picking:
            return
        if (point := picking.on_floor(click, extent)) is not None:
            x, y = (round(value, 3) for value in point)
            self.control.put("picked", {"picked": {"x": x, "y": y, "place": picking.place_at(point, places)}})

    def look_at(self, extent: Extent) -> None:
        """The map is another one."""
        self._put(self.eye.look_at(extent))
        self._tell()

    def robot_at(self, pose: Pose, now: float) -> None:
        """The robot is there now."""
        self._put(self.eye.robot_at(pose, now))

    def _put(self, view: View | None) -> None:
        if view is not None and self.page is not None:
            self.page.put("camera", viser_wire.camera(view))

    def _tell(self) -> None:
        if self.control is not None and self._said != self.eye.view:
            self._said = self.eye.view
            self.control.put("view", {"view": self.eye.view})


class Viewers:
    """All of them, and what they look at."""

    def __init__(self) -> None:
        self._by_key: dict[Key, Viewer] = {}
        self._in_use: dict[Key, int] = {}
        self._extent: Extent = (-5.0, -5.0, 5.0, 5.0)  # until there is a map
        self._places: list[Place] = []
        self._robot: Pose | None = None

    @contextmanager
    def viewer(self, key: Key) -> Iterator[Viewer]:
        """The viewer with that key, kept as long as anybody uses it."""
        viewer = self._by_key.setdefault(key, Viewer(Eye(self._extent, self._robot)))
        self._in_use[key] = self._in_use.get(key, 0) + 1
        try:
            yield viewer
        finally:
            self._in_use[key] -= 1
            if not self._in_use[key]:
                del self._in_use[key], self._by_key[key]

    def moved(self, key: Key) -> None:
        """The viewer with that key, if there is one, has taken the camera in hand."""
        if (viewer := self._by_key.get(key)) is not None:
            viewer.moved()

    def clicked(self, viewer: Viewer, page: Page, click: viser_wire.Click) -> None:
        """A viewer's page tells of a click."""
        viewer.clicked(page, click, self._extent, self._places)

    def look_at(self, extent: Extent, places: list[Place]) -> None:
        """The map is this one from now on."""
        self._extent, self._places = extent, places
        for viewer in self._by_key.values():
            viewer.look_at(extent)

    def robot_at(self, pose: Pose) -> None:
        """The robot is there now."""
        self._robot, now = pose, time.monotonic()
        for viewer in self._by_key.values():
            viewer.robot_at(pose, now)
