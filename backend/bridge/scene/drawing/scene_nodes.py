"""Nodes of the viser scene that are made once and then assigned to, and only with what has changed.

viser numbers every change for ever, and a new viewer's first picture waits for a walk through these numbers. So
nothing is drawn past this file, and what it has assigned is counted. One call at a time.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import viser

from backend import telemetry
from backend.bridge.scene import shapes

Colour = tuple[int, int, int]


class Nodes:
    """Makes the nodes of one viser server. `changes` is how many assignments went out."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._scene = server.scene
        self._shown: dict[str, Any] = {}  # what each node shows, so that only changes are assigned
        self.changes = 0

    def frame(self, name: str, *, visible: bool = True) -> viser.FrameHandle:
        """A place to hang other nodes on, that is not seen itself."""
        return self._scene.add_frame(name, show_axes=False, visible=visible)

    def mesh(
        self, name: str, mesh: shapes.Mesh, colour: Colour, *, opacity: float | None = None, visible: bool = True
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
        """Words that face the viewer."""
        return self._scene.add_label(name, text, position=position, **options)

    def place(self, node: viser.SceneNodeHandle, pose: telemetry.Pose) -> None:
        """Put a node on the floor."""
        self.assign(
            node,
            position=(pose.x, pose.y, 0.0),
            wxyz=(math.cos(pose.yaw / 2), 0.0, 0.0, math.sin(pose.yaw / 2)),
        )

    def assign(self, node: viser.SceneNodeHandle, **values: Any) -> None:
        """Set properties of a node to what they are not yet."""
        for name, value in values.items():
            key = f"{node.name}.{name}"
            if key in self._shown and np.array_equal(self._shown[key], value):
                continue
            self._shown[key] = value
            self.changes += 1
            setattr(node, name, value)
