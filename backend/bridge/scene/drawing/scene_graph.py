"""viser's scene graph, and what each telemetry message changes in it.

Nodes are made once and then updated (see `scene_nodes.py`). It is not thread-safe: one call at a time. viser draws one
scene for readers of every language, so its labels are names and symbols; the page around it shows the sentences. The
symbols are those that the fonts of every system have.
"""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np
import viser

from backend import telemetry
from backend.bridge.scene import viser_internals, viser_port
from backend.bridge.scene.drawing import robot_model, shapes
from backend.bridge.scene.drawing.camera_views import FIELD_OF_VIEW, TYPICAL_ASPECT, map_view
from backend.bridge.scene.drawing.floor_plan import OUTSIDE, FloorPlan
from backend.bridge.scene.drawing.scan_layer import ScanLayer
from backend.bridge.scene.drawing.scene_nodes import Colour, SceneNodes
from backend.bridge.scene.drawing.trail import PIECES, Trail

DARK: Colour = (45, 55, 72)
LIGHT: Colour = (250, 250, 252)
ACCENT: Colour = (37, 99, 235)
TRAIL: Colour = (147, 180, 245)
PREVIEW: Colour = (217, 119, 6)
STOPPED: Colour = (220, 38, 38)
DISCONNECTED: Colour = (120, 130, 145)
CAMERA_VIEW: Colour = (71, 85, 105)

PATH_HEIGHT = 0.06
TRAIL_HEIGHT = 0.04
CAMERA_VIEW_SIZE = 0.45
"""m"""


class SceneGraph:
    """One viser server with the scene in it, listening on loopback. Raises whatever viser raises at its start."""

    def __init__(self, robot_name: str, trail: Trail | None = None) -> None:
        viser_port.require_secret()
        with viser_internals.silenced():
            self._server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        try:
            viser_port.forget_page_requests(self._server)
            viser_internals.wake_pages_in_own_thread(self._server)
            self._make_nodes(robot_name, trail)
        except BaseException:
            self.close()
            raise

    def _make_nodes(self, robot_name: str, trail: Trail | None) -> None:
        self._robot_name = robot_name
        self._is_connected = False  # whether the robot is; nothing is known of it before the first state
        self._map: telemetry.Map | None = None
        self.trail = trail or Trail()
        self.extent: shapes.Extent = (-5.0, -5.0, 5.0, 5.0)  # until there is a map
        scene, nodes = self._server.scene, SceneNodes(self._server)
        self._nodes = nodes
        with self._server.atomic():
            self._set_up_light()
            self._floor_plan = FloorPlan(scene, nodes)
            self._scan_layer = ScanLayer(scene, nodes)
            self._path = nodes.line("/path", ACCENT)
            self._preview = nodes.line("/preview", PREVIEW)
            self._trail_lines = [nodes.line(f"/trail/{number}", TRAIL, thickness=3.0) for number in range(PIECES)]
            self._goal = nodes.frame("/goal", visible=False)
            for part in robot_model.goal(ACCENT):
                nodes.mesh(f"/goal/{part.name}", part.mesh, part.colour)
            self._make_robot()
            self._notice = nodes.label("/notice", "", (0, 0, 0), anchor="center-center", font_screen_scale=1.2)
            self._draw_trail(range(PIECES))
            self._set_initial_view()
        self.show_disconnected()

    @property
    def port(self) -> int:
        """Where viser listens."""
        return int(self._server.get_port())

    @property
    def change_count(self) -> int:
        """How many changes viser has numbered since its start; a new page waits for a walk through all of them."""
        return self._nodes.change_count

    def close(self) -> None:
        """Stop viser's server and its thread."""
        with viser_internals.silenced():
            self._server.stop()

    def draw(self, message: telemetry.AnyMessage) -> None:
        """Draw one message of the robot. Raises `ValueError` for a map of the wrong size."""
        with self._server.atomic():
            match message:
                case telemetry.State():
                    self._draw_state(message)
                case telemetry.Scan():
                    self._scan_layer.draw(message, time.monotonic())
                case telemetry.Path():
                    self._draw_path(message)
                case telemetry.Map():
                    self._draw_map(message)
                case telemetry.Picture():
                    self._draw_camera_view(message)
                case telemetry.Hello():
                    self._robot_name = message.robot
                case telemetry.Speech():
                    pass  # the state contains what the robot says, for as long as it says it

    def show_disconnected(self) -> None:
        """Show that the robot is disconnected: what was drawn last stays, in grey."""
        self._is_connected = False
        with self._server.atomic():
            self._nodes.update(self._notice, text=f"{self._robot_name} ?", visible=True)
            self._nodes.update(self._label, visible=False)
            self._nodes.update(self._camera_view, visible=False)
            self._scan_layer.hide()
            self._tint(DISCONNECTED)

    def hide_camera_view(self) -> None:
        """Nobody watches the robot's camera any more."""
        self._nodes.update(self._camera_view, visible=False)

    def _draw_state(self, state: telemetry.State) -> None:
        if not self._is_connected:
            self._is_connected = True
            self._nodes.update(self._notice, visible=False)
            self._nodes.update(self._robot, visible=True)
            self._nodes.update(self._label, visible=True)
        self._nodes.set_pose(self._robot, state.pose)
        if (piece := self.trail.add(state.pose)) is not None:
            self._draw_trail([piece])
        label, colour = self._robot_name, ACCENT
        if state.stop is not None:
            label, colour = f"{self._robot_name} ■ {state.stop.by}", STOPPED
        elif state.speaking is not None:
            label = f"{self._robot_name}: “{_shortened(state.speaking)}”"
        self._nodes.update(self._label, text=label)
        self._tint(colour)
        goal = state.motion.goal if state.motion is not None and state.motion.kind == "navigate" else None
        self._nodes.update(self._goal, visible=goal is not None)
        if goal is not None:
            self._nodes.set_pose(self._goal, goal)

    def _draw_trail(self, pieces: Iterable[int]) -> None:
        for number in pieces:
            points = self.trail.pieces[number]
            if len(points) > 1:
                self._nodes.update(self._trail_lines[number], points=shapes.segments_of(points, TRAIL_HEIGHT))
            self._nodes.update(self._trail_lines[number], visible=len(points) > 1)

    def _draw_path(self, path: telemetry.Path) -> None:
        node, other = (self._preview, self._path) if path.preview else (self._path, self._preview)
        self._nodes.update(node, points=shapes.segments_of(path.points, PATH_HEIGHT), visible=len(path.points) > 1)
        self._nodes.update(other, visible=False)

    def _draw_camera_view(self, picture: telemetry.Picture) -> None:
        aspect = picture.width / picture.height
        fov = robot_model.vertical_field_of_view(aspect)
        self._nodes.update(self._camera_view, aspect=aspect, fov=fov, visible=True)

    def _draw_map(self, grid: telemetry.Map) -> None:
        if grid == self._map:  # the robot sends it with every subscription
            return
        extent = self._floor_plan.draw(grid)
        self._scan_layer.set_map(grid)
        if self._map is not None:
            self.trail.clear()
            self._draw_trail(range(PIECES))
        self._map = grid
        if extent != self.extent:
            self.extent = x0, y0, x1, y1 = extent
            self._nodes.update(self._notice, position=((x0 + x1) / 2, (y0 + y1) / 2, 1.0))
            self._set_initial_view()

    def _set_initial_view(self) -> None:
        """The view of a page that has not reported its shape yet."""
        view = map_view(self.extent, TYPICAL_ASPECT)
        camera = self._server.initial_camera
        camera.position = view.position
        camera.look_at = view.look_at
        camera.fov = FIELD_OF_VIEW

    def _make_robot(self) -> None:
        nodes = self._nodes
        self._robot = nodes.frame("/robot", visible=False)
        self._tinted = []
        for part in robot_model.parts(DARK, LIGHT, ACCENT):
            node = nodes.mesh(f"/robot/{part.name}", part.mesh, part.colour, opacity=part.opacity)
            if part.tinted:
                self._tinted.append(node)
        label_position = (0, 0, robot_model.HEIGHT + 0.25)
        self._label = nodes.label("/robot/name", self._robot_name, label_position, anchor="bottom-center")
        self._camera_view = self._server.scene.add_camera_frustum(
            "/robot/camera",
            robot_model.vertical_field_of_view(4 / 3),
            4 / 3,
            scale=CAMERA_VIEW_SIZE,
            thickness=2.0,
            thickness_units="screen",
            color=CAMERA_VIEW,
            wxyz=robot_model.CAMERA_WXYZ,
            position=robot_model.CAMERA_POSITION,
            visible=False,
            cast_shadow=False,
            receive_shadow=False,
            variant="filled",
        )

    def _set_up_light(self) -> None:
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
            self._nodes.update(node, color=colour)


def _shortened(text: str, limit: int = 60) -> str:
    return text if len(text) <= limit else text[: limit - 1].rstrip() + "…"
