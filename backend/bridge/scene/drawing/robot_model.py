"""The bodies of the scene: the robot (round base, slim body, head with a visor, arrow on the floor), a post, the goal.

They are drawings, not measurements: the robot's real footprint is known to the robot server alone. Lengths in m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from backend.bridge.scene.drawing import shapes
from backend.bridge.scene.drawing.shapes import Mesh

HEIGHT = 1.25
"""Labels float above it."""
CAMERA_POSITION = (0.14, 0.0, 1.11)
"""Of the robot's camera in the robot's frame: the middle of the visor."""
CAMERA_WXYZ = (0.5, -0.5, 0.5, -0.5)
"""The rotation (w, x, y, z) that turns a camera's z axis forward and its y axis down."""
CAMERA_FIELD_OF_VIEW = math.radians(78)
"""Horizontal. It is that of the simulator's camera, as telemetry does not report it."""

Colour = tuple[int, int, int]


@dataclass(frozen=True)
class Part:
    """One body. `tinted` parts take on the colour of the robot's status."""

    name: str
    mesh: Mesh
    colour: Colour
    tinted: bool = False
    opacity: float | None = None


def parts(dark: Colour, light: Colour, accent: Colour) -> list[Part]:
    """The robot's bodies in its own frame: x forward, its middle on the floor at the origin."""
    base = shapes.lathe([(0.0, 0.04), (0.26, 0.04), (0.29, 0.09), (0.29, 0.19), (0.25, 0.25), (0.0, 0.25)])
    neck = shapes.lathe([(0.07, 0.9), (0.07, 1.02)])
    laser = shapes.lathe([(0.07, 0.25), (0.07, 0.33), (0.0, 0.33)], centre=(0.16, 0.0))
    body = shapes.lathe([(0.19, 0.25), (0.2, 0.3), (0.13, 0.86), (0.1, 0.91), (0.0, 0.92)])
    head = shapes.lathe(
        [(0.0, 1.0), (0.13, 1.01), (0.17, 1.06), (0.17, 1.16), (0.13, 1.23), (0.07, HEIGHT), (0.0, HEIGHT)]
    )
    visor = shapes.box((0.1, -0.115, 1.07), (0.178, 0.115, 1.15))
    arrow = shapes.joined(
        [
            shapes.polygon([(0.78, -0.42), (1.42, 0.0), (0.96, 0.0)], 0.03),
            shapes.polygon([(0.96, 0.0), (1.42, 0.0), (0.78, 0.42)], 0.03),
        ]
    )
    return [
        Part("dark", shapes.joined([base, neck, laser, visor]), dark),
        Part("light", shapes.joined([body, head]), light),
        Part("heading", shapes.joined([arrow, shapes.ring(0.58, 0.7, 0.03)]), accent, tinted=True),
        Part("glow", shapes.ring(0.0, 0.58, 0.025), accent, tinted=True, opacity=0.25),
    ]


def vertical_field_of_view(aspect: float) -> float:
    """The vertical field of view of the robot's camera in rad, for pictures of that width to height."""
    return 2 * math.atan(math.tan(CAMERA_FIELD_OF_VIEW / 2) / aspect)


def post() -> Mesh:
    """The post of an obstacle, with a radius and a height of 1 m; its node scales it."""
    return shapes.lathe([(1.0, 0.0), (1.0, 0.9), (0.8, 0.98), (0.0, 1.0)], segments=24)


def goal(colour: Colour) -> list[Part]:
    """The goal's bodies: a target on the floor with an arrow for the final heading, and a pin above it."""
    pin = shapes.lathe([(0.0, 0.1), (0.2, 0.85), (0.24, 1.0), (0.2, 1.15), (0.1, 1.24), (0.0, 1.26)])
    arrow = shapes.polygon([(0.66, -0.26), (1.08, 0.0), (0.66, 0.26)], 0.03)
    return [
        Part("target", shapes.joined([shapes.ring(0.42, 0.56, 0.03), arrow]), colour),
        Part("pin", pin, colour),
    ]
