"""The viser scene and what each telemetry message changes in it.

Nodes are made once and then assigned to, and only what has changed is assigned: viser numbers every change for
ever, and a new viewer's first picture waits for a walk through these numbers. One call at a time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import rich
import viser

from backend import telemetry
from backend.bridge.scene import robot, shapes
from backend.bridge.scene.viewers import Viewers

Colour = tuple[int, int, int]

FLOOR: Colour = (247, 248, 250)
FLOOR_LINE: Colour = (230, 233, 238)
OUTSIDE: Colour = (206, 212, 221)
WALL: Colour = (154, 165, 181)
WALL_TOP: Colour = (91, 103, 122)
DARK: Colour = (45, 55, 72)
LIGHT: Colour = (250, 250, 252)
ACCENT: Colour = (37, 99, 235)
PREVIEW: Colour = (217, 119, 6)
LASER: Colour = (13, 148, 136)
STOPPED: Colour = (220, 38, 38)
AWAY: Colour = (120, 130, 145)

WALL_HEIGHT = 0.7
PATH_HEIGHT = 0.06
LASER_HEIGHT = 0.3
PLACE_OFFSET = 0.9
"""m that a name stands beside its place, so that the robot can be seen there."""


class Stage:
    """One viser server with the scene in it. `port` is where it listens, on loopback alone."""

    def __init__(self, robot_name: str) -> None:
        with _silent():
            self._server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        self._shown: dict[str, Any] = {}  # what each node shows, so that only changes are assigned
        self._places: list[viser.LabelHandle] = []
        self._grid: telemetry.Map | None = None
        self._name = robot_name
        self._online = False
        self._viewers = Viewers(self._server)
        scene = self._server.scene
        with self._server.atomic():
            self._light_up()
            floor = np.full((2, 2, 3), OUTSIDE, np.uint8)
            self._floor = scene.add_image("/map/floor", floor, 1.0, 1.0, format="png", cast_shadow=False)
            nothing = shapes.joined([])
            self._walls = self._mesh("/map/walls", nothing, WALL)
            self._tops = self._mesh("/map/tops", nothing, WALL_TOP)
            self._path = self._line("/path", ACCENT)
            self._preview = self._line("/preview", PREVIEW)
            self._laser = scene.add_frame("/laser", show_axes=False)
            self._points = scene.add_point_cloud(
                "/laser/points",
                np.array([[0, 0, -100]], np.float32),
                LASER,
                point_size=0.09,
                point_shape="circle",
                point_shading="flat",
                precision="float32",
            )
            self._goal = scene.add_frame("/goal", show_axes=False, visible=False)
            for part in robot.goal(ACCENT):
                self._mesh(f"/goal/{part.name}", part.mesh, part.colour)
            self._robot = scene.add_frame("/robot", show_axes=False, visible=False)
            self._tinted = []
            for part in robot.parts(DARK, LIGHT, ACCENT):
                node = self._mesh(f"/robot/{part.name}", part.mesh, part.colour, opacity=part.opacity)
                if part.tinted:
                    self._tinted.append(node)
            self._label = scene.add_label(
                "/robot/name", robot_name, position=(0, 0, robot.HEIGHT + 0.25), anchor="bottom-center"
            )
            self._notice = scene.add_label("/notice", "", anchor="center-center", font_screen_scale=1.2)
        self.lost()

    @property
    def port(self) -> int:
        """Where viser listens."""
        return int(self._server.get_port())

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
                    self._show_scan(message)
                case telemetry.Path():
                    self._show_path(message)
                case telemetry.Map():
                    self._show_map(message)
                case telemetry.Hello():
                    self._name = message.robot
                case telemetry.Speech():
                    pass  # the state says what is being said, and for how long
                case telemetry.Picture():
                    pass  # pictures do not go through viser

    def lost(self) -> None:
        """Say that the robot is gone; what was seen last stays, greyed."""
        self._online = False
        with self._server.atomic():
            self._assign(self._notice, text=f"{self._name} is not connected. Trying again.", visible=True)
            self._assign(self._points, visible=False)
            self._assign(self._label, visible=False)
            self._tint(AWAY)

    def _show_state(self, state: telemetry.State) -> None:
        if not self._online:
            self._online = True
            self._assign(self._notice, visible=False)
            self._assign(self._points, visible=True)
            self._assign(self._robot, visible=True)
            self._assign(self._label, visible=True)
        self._place(self._robot, state.pose)
        label, colour = self._name, ACCENT
        if state.stop is not None:
            label, colour = f"{self._name} · stopped by {state.stop.by}", STOPPED
        elif state.speaking is not None:
            label = f"{self._name}: “{_short(state.speaking)}”"
        self._assign(self._label, text=label)
        self._tint(colour)
        goal = state.motion.goal if state.motion is not None and state.motion.kind == "navigate" else None
        self._assign(self._goal, visible=goal is not None)
        if goal is not None:
            self._place(self._goal, goal)

    def _show_scan(self, scan: telemetry.Scan) -> None:
        # Below the pose it was taken at, not below the robot: the robot has moved on since.
        self._place(self._laser, scan.pose)
        self._points.points = shapes.hits(
            scan.angle_min, scan.angle_increment, scan.ranges, scan.range_max, LASER_HEIGHT
        )

    def _show_path(self, path: telemetry.Path) -> None:
        node, other = (self._preview, self._path) if path.preview else (self._path, self._preview)
        node.points = shapes.segments_of(path.points, PATH_HEIGHT)
        self._assign(node, visible=len(path.points) > 1)
        self._assign(other, visible=False)

    def _show_map(self, grid: telemetry.Map) -> None:
        if grid == self._grid:  # it comes with every subscription
            return
        self._grid = grid
        cells = np.frombuffer(grid.cells, np.uint8).reshape(grid.height, grid.width)
        origin = (grid.origin_x, grid.origin_y)
        width, height = grid.width * grid.resolution, grid.height * grid.resolution
        self._floor.image = shapes.floor_picture(
            cells, grid.resolution, origin, free=FLOOR, line=FLOOR_LINE, outside=OUTSIDE
        )
        self._floor.render_width, self._floor.render_height = width, height
        self._floor.position = (origin[0] + width / 2, origin[1] + height / 2, 0.0)
        sides, tops = shapes.walls(cells == 100, grid.resolution, origin, WALL_HEIGHT)
        for node, mesh in ((self._walls, sides), (self._tops, tops)):
            node.vertices, node.faces = mesh.vertices, mesh.faces
        for label in self._places:
            label.remove()
        self._places = [
            self._server.scene.add_label(
                f"/places/{number}",
                place.name,
                position=(place.pose.x, place.pose.y - PLACE_OFFSET, 0.05),
                font_screen_scale=0.8,
                anchor="center-center",
            )
            for number, place in enumerate(grid.places)
        ]
        extent = x0, y0, x1, y1 = shapes.extent(cells, grid.resolution, origin)
        self._notice.position = ((x0 + x1) / 2, (y0 + y1) / 2, WALL_HEIGHT)
        self._viewers.look_at(extent)

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

    def _mesh(self, name: str, mesh: shapes.Mesh, colour: Colour, *, opacity: float | None = None) -> viser.MeshHandle:
        return self._server.scene.add_mesh_simple(
            name,
            mesh.vertices,
            mesh.faces,
            color=colour,
            opacity=opacity,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
            flat_shading=False,
        )

    def _line(self, name: str, colour: Colour) -> viser.LineSegmentsHandle:
        return self._server.scene.add_line_segments(
            name,
            np.zeros((1, 2, 3), np.float32),
            colour,
            thickness=4.0,
            thickness_units="screen",
            visible=False,
        )

    def _tint(self, colour: Colour) -> None:
        for node in self._tinted:
            self._assign(node, color=colour)

    def _place(self, node: viser.SceneNodeHandle, pose: telemetry.Pose) -> None:
        self._assign(node, position=(pose.x, pose.y, 0.0))
        self._assign(node, wxyz=(math.cos(pose.yaw / 2), 0.0, 0.0, math.sin(pose.yaw / 2)))

    def _assign(self, node: viser.SceneNodeHandle, **values: Any) -> None:
        for name, value in values.items():
            key = f"{node.name}.{name}"
            if self._shown.get(key) != value:
                self._shown[key] = value
                setattr(node, name, value)


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
