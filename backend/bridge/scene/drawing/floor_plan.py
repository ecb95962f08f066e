"""The map as a floor plan: the floor with its keep-out zones, the walls, and the names of places and zones.

It changes only with the map, and is then computed anew as a whole.
"""

from __future__ import annotations

import numpy as np
import viser

from backend import telemetry
from backend.bridge.scene.drawing import shapes, zones
from backend.bridge.scene.drawing.scene_nodes import Colour, SceneNodes

FLOOR: Colour = (247, 248, 250)
FLOOR_LINE: Colour = (230, 233, 238)
OUTSIDE: Colour = (206, 212, 221)
WALL: Colour = (154, 165, 181)
WALL_TOP: Colour = (91, 103, 122)

WALL_HEIGHT = 0.7
"""m"""
_PIXELS_PER_CELL = 3
"""Of the floor's picture, in each direction."""


class FloorPlan:
    """Draws one map after the other."""

    def __init__(self, scene: viser.SceneApi, nodes: SceneNodes) -> None:
        self._nodes = nodes
        floor = np.full((2, 2, 3), OUTSIDE, np.uint8)
        self._floor = scene.add_image("/map/floor", floor, 1.0, 1.0, format="png", cast_shadow=False)
        nothing = shapes.joined([])
        self._walls = nodes.mesh("/map/walls", nothing, WALL)
        self._wall_tops = nodes.mesh("/map/tops", nothing, WALL_TOP)
        self._names: list[viser.LabelHandle] = []

    def draw(self, grid: telemetry.Map) -> shapes.Extent:
        """Draw a map, and return the part of it that is known. Raises `ValueError` for a map of the wrong size."""
        cells = np.frombuffer(grid.cells, np.uint8).reshape(grid.height, grid.width)
        origin = (grid.origin_x, grid.origin_y)
        width, height = grid.width * grid.resolution, grid.height * grid.resolution
        picture = shapes.floor_picture(
            cells, grid.resolution, origin, free=FLOOR, line=FLOOR_LINE, outside=OUTSIDE, scale=_PIXELS_PER_CELL
        )
        zones.paint(picture, grid.zones, grid.resolution / _PIXELS_PER_CELL, origin)
        self._nodes.update(
            self._floor,
            image=picture,
            render_width=width,
            render_height=height,
            position=(origin[0] + width / 2, origin[1] + height / 2, 0.0),
        )
        sides, tops = shapes.walls(cells == 100, grid.resolution, origin, WALL_HEIGHT)
        for node, mesh in ((self._walls, sides), (self._wall_tops, tops)):
            self._nodes.update(node, vertices=mesh.vertices, faces=mesh.faces)
        self._draw_names(grid)
        return shapes.extent(cells, grid.resolution, origin)

    def _draw_names(self, grid: telemetry.Map) -> None:
        for label in self._names:
            label.remove()
        labels = [
            (f"/places/{number}", place.name, (place.pose.x, place.pose.y - shapes.NAME_OFFSET), 0.8)
            for number, place in enumerate(grid.places)
        ] + [
            (f"/zones/{number}", f"× {zone.name}", zones.centroid(zone.polygon), 0.7)
            for number, zone in enumerate(grid.zones)
            if zone.polygon
        ]
        self._names = [
            self._nodes.label(name, text, (x, y, 0.05), font_screen_scale=size, anchor="center-center")
            for name, text, (x, y), size in labels
        ]
