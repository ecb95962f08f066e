"""The viser scene and what each telemetry message changes in it.

Nodes are made once and then assigned to (see `nodes.py`). One call at a time. Readers of every language see the same
scene, so its labels are names and signs, of those that every system's fonts have; the pages around it say the sentence.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import rich
import viser

from backend import telemetry
from backend.bridge.scene import robot, shapes, wakeup
from backend.bridge.scene.building import OUTSIDE, Building
from backend.bridge.scene.camera import FIELD_OF_VIEW, TYPICAL_ASPECT, fitting
from backend.bridge.scene.nodes import Colour, Nodes
from backend.bridge.scene.surroundings import Surroundings
from backend.bridge.scene.trail import PIECES, Trail

DARK: Colour = (45, 55, 72)
LIGHT: Colour = (250, 250, 252)
ACCENT: Colour = (37, 99, 235)
TRAIL: Colour = (147, 180, 245)
PREVIEW: Colour = (217, 119, 6)
STOPPED: Colour = (220, 38, 38)
AWAY: Colour = (120, 130, 145)
SIGHT: Colour = (71, 85, 105)

PATH_HEIGHT = 0.06
TRAIL_HEIGHT = 0.04
SIGHT_SIZE = 0.45


class Stage:
    """One viser server with the scene in it. `port` is where it listens, on loopback alone."""

    def __init__(self, robot_name: str, trail: Trail | None = None) -> None:
        with _silent():
            self._server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        try:
            wakeup.in_its_own_thread(self._server)
            self._set_up(robot_name, trail)
        except BaseException:
            self.close()
            raise

    def _set_up(self, robot_name: str, trail: Trail | None) -> None:
        self._name = robot_name
        self._online = False
        self._grid: telemetry.Map | None = None
        self.trail = trail or Trail()
        self.extent: shapes.Extent = (-5.0, -5.0, 5.0, 5.0)  # until there is a map
        scene, nodes = self._server.scene, Nodes(self._server)
        self._nodes = nodes
        with self._server.atomic():
            self._light_up()
            self._building = Building(scene, nodes)
            self._surroundings = Surroundings(scene, nodes)
            self._path = nodes.line("/path", ACCENT)
            self._preview = nodes.line("/preview", PREVIEW)
            self._pieces = [nodes.line(f"/trail/{number}", TRAIL, thickness=3.0) for number in range(PIECES)]
            self._goal = nodes.frame("/goal", visible=False)
            for part in robot.goal(ACCENT):
                nodes.mesh(f"/goal/{part.name}", part.mesh, part.colour)
            self._make_robot()
            self._notice = nodes.label("/notice", "", (0, 0, 0), anchor="center-center", font_screen_scale=1.2)
            self._show_trail(range(PIECES))
            self._set_initial_view()
        self.lost()

    @property
    def port(self) -> int:
        """Where viser listens."""
        return int(self._server.get_port())

    @property
    def changes(self) -> int:
        """How many changes viser has numbered so far; a new viewer waits for a walk through them."""
        return self._nodes.changes

    def close(self) -> None:
        """Stop viser's server and its thread."""
        with _silent():
            self._server.stop()

    def show(self, message: telemetry.AnyMessage) -> None:
        """Draw one message of the robot."""
        with self._server.atomic():
            match message:
                case telemetry.State():
                    self._show_state(message)
                case telemetry.Scan():
                    self._surroundings.show(message, time.monotonic())
                case telemetry.Path():
                    self._show_path(message)
                case telemetry.Map():
                    self._show_map(message)
                case telemetry.Picture():
                    self._show_sight(message)
                case telemetry.Hello():
                    self._name = message.robot
                case telemetry.Speech():
                    pass  # the state says what is being said, and for how long

    def lost(self) -> None:
        """Say that the robot is gone; what was seen last stays, greyed."""
        self._online = False
        with self._server.atomic():
            self._nodes.assign(self._notice, text=f"{self._name} ?", visible=True)
            self._nodes.assign(self._label, visible=False)
            self._nodes.assign(self._sight, visible=False)
            self._surroundings.hide()
            self._tint(AWAY)

    def camera_off(self) -> None:
        """Nobody looks through the robot's camera any more."""
        self._nodes.assign(self._sight, visible=False)

    def _show_state(self, state: telemetry.State) -> None:
        if not self._online:
            self._online = True
            self._nodes.assign(self._notice, visible=False)
            self._nodes.assign(self._robot, visible=True)
            self._nodes.assign(self._label, visible=True)
        self._nodes.place(self._robot, state.pose)
        if (piece := self.trail.follow(state.pose)) is not None:
            self._show_trail([piece])
        label, colour = self._name, ACCENT
        if state.stop is not None:
            label, colour = f"{self._name} ■ {state.stop.by}", STOPPED
        elif state.speaking is not None:
            label = f"{self._name}: “{_short(state.speaking)}”"
        self._nodes.assign(self._label, text=label)
        self._tint(colour)
        goal = state.motion.goal if state.motion is not None and state.motion.kind == "navigate" else None
        self._nodes.assign(self._goal, visible=goal is not None)
        if goal is not None:
            self._nodes.place(self._goal, goal)

    def _show_trail(self, pieces: range | list[int]) -> None:
        for number in pieces:
            points = self.trail.pieces[number]
            if len(points) > 1:
                self._nodes.assign(self._pieces[number], points=shapes.segments_of(points, TRAIL_HEIGHT))
            self._nodes.assign(self._pieces[number], visible=len(points) > 1)

    def _show_path(self, path: telemetry.Path) -> None:
        node, other = (self._preview, self._path) if path.preview else (self._path, self._preview)
        self._nodes.assign(node, points=shapes.segments_of(path.points, PATH_HEIGHT), visible=len(path.points) > 1)
        self._nodes.assign(other, visible=False)

    def _show_sight(self, picture: telemetry.Picture) -> None:
        aspect = picture.width / picture.height
        self._nodes.assign(self._sight, aspect=aspect, fov=robot.sight_height(aspect), visible=True)

    def _show_map(self, grid: telemetry.Map) -> None:
        if grid == self._grid:  # it comes with every subscription
            return
        extent = self._building.show(grid)
        self._surroundings.on(grid)
        if self._grid is not None:
            self.trail.clear()
            self._show_trail(range(PIECES))
        self._grid = grid
        if extent != self.extent:
            self.extent = x0, y0, x1, y1 = extent
            self._nodes.assign(self._notice, position=((x0 + x1) / 2, (y0 + y1) / 2, 1.0))
            self._set_initial_view()

    def _set_initial_view(self) -> None:
        """Where a page begins that says nothing of its shape yet."""
        view = fitting(self.extent, TYPICAL_ASPECT)
        camera = self._server.initial_camera
        camera.position = view.position
        camera.look_at = view.look_at
        camera.fov = FIELD_OF_VIEW

    def _make_robot(self) -> None:
        nodes = self._nodes
        self._robot = nodes.frame("/robot", visible=False)
        self._tinted = []
        for part in robot.parts(DARK, LIGHT, ACCENT):
            node = nodes.mesh(f"/robot/{part.name}", part.mesh, part.colour, opacity=part.opacity)
            if part.tinted:
                self._tinted.append(node)
        self._label = nodes.label("/robot/name", self._name, (0, 0, robot.HEIGHT + 0.25), anchor="bottom-center")
        self._sight = self._server.scene.add_camera_frustum(
            "/robot/sight",
            robot.sight_height(4 / 3),
            4 / 3,
            scale=SIGHT_SIZE,
            thickness=2.0,
            thickness_units="screen",
            color=SIGHT,
            wxyz=robot.EYE_FORWARD,
            position=robot.EYE,
            visible=False,
            cast_shadow=False,
            receive_shadow=False,
            variant="filled",
        )

    def _light_up(self) -> None:
        scene = self._server.scene
        scene.set_up_direction("+z")
        scene.world_axes.visible = False
        scene.configure_default_lights(False)
        scene.configure_environment_map(None)
        scene.add_light_ambient("/light/all", intensity=1.6)
        scene.add_light_directional("/light/sun", intensity=1.5, position=(-4.0, -9.0, 12.0), cast_shadow=False)
        scene.set_background_image(np.full((2, 2, 3), OUTSIDE, np.uint8), format="png")
        self._server.gui.configure_theme(show_logo=False, show_share_button=False, dark_mode=False)

    def _tint(self, colour: Colour) -> None:
        for node in self._tinted:
            self._nodes.assign(node, color=colour)


@contextmanager
def _silent() -> Iterator[None]:
    """viser announces its start and end on standard output, whatever `verbose` says."""
    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before


def _short(text: str, limit: int = 60) -> str:
    return text if len(text) <= limit else text[: limit - 1].rstrip() + "…"
