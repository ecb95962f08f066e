"""The map as a building: floor with its keep-out zones, walls, and the names of places and zones.

It changes only with the map; all of it is computed anew then, and nothing in between.
"""

from __future__ import annotations

import numpy as np
import viser

from backend import telemetry
from backend.bridge.scene import shapes, zones
from backend.bridge.scene.nodes import Colour, Nodes

FLOOR: Colour = (247, 248, 250)
FLOOR_LINE: Colour = (230, 233, 238)
OUTSIDE: Colour = (206, 212, 221)
WALL: Colour = (154, 165, 181)
WALL_TOP: Colour = (91, 103, 122)

WALL_HEIGHT = 0.7
_SCALE = 3
"""Pixels of the floor's picture for a cell of the map, in each direction."""


class Building:
    """Draws one map after the other."""

    def __init__(self, scene: viser.SceneApi, nodes: Nodes) -> None:
        self._nodes = nodes
        floor = np.full((2, 2, 3), OUTSIDE, np.uint8)
        self._floor = scene.add_image("/map/floor", floor, 1.0, 1.0, format="png", cast_shadow=False)
        nothing = shapes.joined([])
        self._walls = nodes.mesh("/map/walls", nothing, WALL)
        self._tops = nodes.mesh("/map/tops", nothing, WALL_TOP)
        self.names: list[viser.LabelHandle] = []

    def show(self, grid: telemetry.Map) -> shapes.Extent:
        """Draw a map; the part of it that is worth seeing. Raises `ValueError` for a map that is none."""
        cells = np.frombuffer(grid.cells, np.uint8).reshape(grid.height, grid.width)
        origin = (grid.origin_x, grid.origin_y)
        width, height = grid.width * grid.resolution, grid.height * grid.resolution
        picture = shapes.floor_picture(
            cells, grid.resolution, origin, free=FLOOR, line=FLOOR_LINE, outside=OUTSIDE, scale=_SCALE
        )
        zones.paint(picture, grid.zones, grid.resolution / _SCALE, origin)
        self._nodes.assign(
            self._floor,
            image=picture,
            render_width=width,
            render_height=height,
            position=(origin[0] + width / 2, origin[1] + height / 2, 0.0),
        )
        sides, tops = shapes.walls(cells == 100, grid.resolution, origin, WALL_HEIGHT)
        for node, mesh in ((self._walls, sides), (self._tops, tops)):
            self._nodes.assign(node, vertices=mesh.vertices, faces=mesh.faces)
        self._show_names(grid)
        return shapes.extent(cells, grid.resolution, origin)

    def _show_names(self, grid: telemetry.Map) -> None:
        for label in self.names:
            label.remove()
        words = [
            (f"/places/{number}", place.name, (place.pose.x, place.pose.y - shapes.NAME_OFFSET), 0.8)
            for number, place in enumerate(grid.places)
        ] + [
            (f"/zones/{number}", f"× {zone.name}", zones.middle(zone.polygon), 0.7)
            for number, zone in enumerate(grid.zones)
            if zone.polygon
        ]
        self.names = [
            self._nodes.label(name, text, (x, y, 0.05), font_screen_scale=size, anchor="center-center")
            for name, text, (x, y), size in words
        ]
