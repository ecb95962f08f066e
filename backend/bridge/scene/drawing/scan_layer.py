"""What the laser measures: its points, and a post for each obstacle that the map does not explain.

A fixed number of posts is made once; they are moved and hidden, never made or removed.
"""

from __future__ import annotations

import numpy as np
import viser

from backend import telemetry
from backend.bridge.scene.drawing import obstacle_detection, robot_model, shapes
from backend.bridge.scene.drawing.scene_nodes import Colour, SceneNodes

LASER: Colour = (13, 148, 136)
OBSTACLE: Colour = (176, 84, 158)

LASER_HEIGHT = 0.3
POST_HEIGHT = 1.2
"""m"""
_DETECTION_SECONDS = 0.1
"""s between two detections: nobody can see a post that moves more often, and each change costs."""
_LASER_NOISE = 0.1
"""m. Points that are all this near to the drawn ones are not drawn again, which would cost each page a picture."""
_NO_POINTS = np.array([[0, 0, -100]], np.float32)  # one point out of sight, as a point cloud cannot be empty


class ScanLayer:
    """Draws one scan after the other."""

    def __init__(self, scene: viser.SceneApi, nodes: SceneNodes) -> None:
        self._nodes = nodes
        self._map: obstacle_detection.ExplainedMap | None = None
        self._tracker = obstacle_detection.ObstacleTracker()
        self._next_detection = 0.0  # s of the clock that `draw` is called with
        self._drawn = _NO_POINTS
        self._points = scene.add_point_cloud(
            "/laser",
            _NO_POINTS,
            LASER,
            point_size=0.07,
            point_shape="circle",
            point_shading="flat",
            precision="float32",  # the default, float16, has steps of 6 cm far from the origin
        )
        self._posts = [
            nodes.mesh(f"/obstacles/{number}", robot_model.post(), OBSTACLE, visible=False)
            for number in range(obstacle_detection.MAX_OBSTACLES)
        ]

    def set_map(self, grid: telemetry.Map) -> None:
        """Compare the readings with this map from now on."""
        self._map = obstacle_detection.ExplainedMap(grid)
        self._tracker.clear()
        self._update_posts()

    def draw(self, scan: telemetry.Scan, now: float) -> None:
        """Draw a scan; `now` is in s of any clock that never goes back."""
        # The points are in the map frame, not children of the robot's node: the robot has moved on since the scan, and
        # a page applies points and poses at different moments.
        points = shapes.hits(scan, LASER_HEIGHT)
        drawable = points if len(points) else _NO_POINTS
        if not _are_alike(drawable, self._drawn):
            self._drawn = drawable
        self._nodes.update(self._points, points=self._drawn, visible=True)
        if self._map is not None and now >= self._next_detection:
            self._next_detection = now + _DETECTION_SECONDS
            self._tracker.update(obstacle_detection.detect(points[:, :2], scan.pose, self._map), now)
            self._update_posts()

    def hide(self) -> None:
        """Hide points and posts."""
        self._nodes.update(self._points, visible=False)
        self._tracker.clear()
        self._update_posts()

    def _update_posts(self) -> None:
        for node, obstacle in zip(self._posts, self._tracker.slots, strict=True):
            if obstacle is not None:
                size = (obstacle.radius, obstacle.radius, POST_HEIGHT)
                self._nodes.update(node, position=(obstacle.x, obstacle.y, 0.0), scale=size)
            self._nodes.update(node, visible=obstacle is not None)


def _are_alike(points: np.ndarray, others: np.ndarray) -> bool:
    return points.shape == others.shape and bool(np.all(np.abs(points - others) < _LASER_NOISE))
