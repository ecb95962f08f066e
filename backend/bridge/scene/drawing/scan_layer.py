"""What the laser sees: its points, and a post for whatever the map does not explain.

A fixed number of posts is made once; they are moved and hidden, never made or removed.
"""

from __future__ import annotations

import numpy as np
import viser

from backend import telemetry
from backend.bridge.scene import obstacles, robot, shapes
from backend.bridge.scene.nodes import Colour, Nodes

LASER: Colour = (13, 148, 136)
OBSTACLE: Colour = (176, 84, 158)

LASER_HEIGHT = 0.3
POST_HEIGHT = 1.2
_LOOK_EVERY = 0.1
"""s between looks for obstacles: nobody sees a faster post, and each change costs."""
_ALIKE = 0.1
"""m, more than a laser's noise: points that are all within it of those that are drawn cost no page a new picture."""
_NOTHING = np.array([[0, 0, -100]], np.float32)  # out of sight, as a cloud cannot be empty


class Surroundings:
    """Draws one scan after the other."""

    def __init__(self, scene: viser.SceneApi, nodes: Nodes) -> None:
        self._nodes = nodes
        self._known: obstacles.Known | None = None
        self._posts = obstacles.Posts()
        self._due = 0.0  # when to look for obstacles next
        self._drawn = _NOTHING
        self.points = scene.add_point_cloud(
            "/laser",
            _NOTHING,
            LASER,
            point_size=0.07,
            point_shape="circle",
            point_shading="flat",
            precision="float32",  # the default has steps of 6 cm far out
        )
        self.posts = [
            nodes.mesh(f"/obstacles/{number}", robot.post(), OBSTACLE, visible=False)
            for number in range(obstacles.MOST)
        ]

    def on(self, grid: telemetry.Map) -> None:
        """From now on the readings are compared with this map."""
        self._known = obstacles.Known(grid)
        self._posts.clear()
        self._show_posts()

    def show(self, scan: telemetry.Scan, now: float) -> None:
        """Draw a scan; `now` is any clock in s that only goes forward."""
        # In the map's frame, not below the robot: it has moved on since, and a page turns points and frames at
        # different moments.
        points = shapes.hits(scan, LASER_HEIGHT)
        drawable = points if len(points) else _NOTHING
        if not _are_alike(drawable, self._drawn):
            self._drawn = drawable
        self._nodes.assign(self.points, points=self._drawn, visible=True)
        if self._known is not None and now >= self._due:
            self._due = now + _LOOK_EVERY
            self._posts.update(obstacles.seen(points[:, :2], scan.pose, self._known), now)
            self._show_posts()

    def hide(self) -> None:
        """Nothing is seen any more."""
        self._nodes.assign(self.points, visible=False)
        self._posts.clear()
        self._show_posts()

    def _show_posts(self) -> None:
        for node, post in zip(self.posts, self._posts.shown, strict=True):
            if post is not None:
                size = (post.radius, post.radius, POST_HEIGHT)
                self._nodes.assign(node, position=(post.x, post.y, 0.0), scale=size)
            self._nodes.assign(node, visible=post is not None)


def _are_alike(points: np.ndarray, others: np.ndarray) -> bool:
    return points.shape == others.shape and bool(np.all(np.abs(points - others) < _ALIKE))
