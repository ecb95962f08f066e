"""Nodes of viser's scene graph that are made once and then updated, and only where a property has changed.

viser numbers every change and never forgets a number, so a redundant update costs every later viewer. Therefore all
drawing goes through this file, which counts its updates. It is not thread-safe: one call at a time.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import viser

from backend import telemetry
from backend.bridge.scene.drawing.shapes import Mesh

Colour = tuple[int, int, int]


class SceneNodes:
    """Makes and updates the nodes of one viser server. `change_count` is how many properties were updated."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._scene = server.scene
        self._shown: dict[str, Any] = {}  # the value of each updated property
        self.change_count = 0

    def frame(self, name: str, *, visible: bool = True) -> viser.FrameHandle:
        """A coordinate frame as the parent of other nodes; it is not drawn itself."""
        return self._scene.add_frame(name, show_axes=False, visible=visible)

    def mesh(
        self, name: str, mesh: Mesh, colour: Colour, *, opacity: float | None = None, visible: bool = True
    ) -> viser.MeshHandle:
        """A body of one colour, without shadows."""
        return self._scene.add_mesh_simple(
            name,
            mesh.vertices,
            mesh.faces,
            color=colour,
            opacity=opacity,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
            flat_shading=False,
            visible=visible,
        )

    def line(self, name: str, colour: Colour, *, thickness: float = 4.0) -> viser.LineSegmentsHandle:
        """A line of `thickness` pixels, hidden until it has points."""
        return self._scene.add_line_segments(
            name,
            np.zeros((1, 2, 3), np.float32),
            colour,
            thickness=thickness,
            thickness_units="screen",
            visible=False,
        )

    def label(self, name: str, text: str, position: tuple[float, float, float], **options: Any) -> viser.LabelHandle:
        """A text that always faces the viewer."""
        return self._scene.add_label(name, text, position=position, **options)

    def set_pose(self, node: viser.SceneNodeHandle, pose: telemetry.Pose) -> None:
        """Move a node to `pose` on the floor."""
        self.update(
            node,
            position=(pose.x, pose.y, 0.0),
            wxyz=(math.cos(pose.yaw / 2), 0.0, 0.0, math.sin(pose.yaw / 2)),
        )

    def update(self, node: viser.SceneNodeHandle, **properties: Any) -> None:
        """Set those properties of a node that have changed."""
        for name, value in properties.items():
            key = f"{node.name}.{name}"
            if key in self._shown and np.array_equal(self._shown[key], value):
                continue
            self._shown[key] = value
            self.change_count += 1
            setattr(node, name, value)
