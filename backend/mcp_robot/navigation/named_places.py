"""Finds a place by the name that people give it. Case, spaces and dashes do not matter; two places never match.

Plain functions over the topological map. An ambiguous or unknown name is refused with the nearest known ones.
"""

from __future__ import annotations

import difflib
import math
import re

from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.robot import TopologicalMap
from backend.telemetry import Place, Pose

_LISTED = 14
"""Names that the refusal of an unknown name lists."""
DOCK_REACH = 0.3
"""A robot this near (m) to a dock's pose stands at it."""


def resolve(name: str, places: TopologicalMap) -> Place:
    """The place of that id or name. Raises `Refusal` (unknown_place) that names those nearest to it."""
    wanted = _key(name)
    for place in places.places:
        if wanted and wanted in (_key(place.id), _key(place.name)):
            return place
    partial = [place for place in places.places if wanted and _key(place.name).endswith(wanted)]
    if len(partial) == 1 and len(wanted) >= 3:  # "2.3.7" for "lab 2.3.7"
        return partial[0]
    shown = name.strip()[:60] or "(no name)"
    if not places.places:
        raise Refusal("unknown_place", "This map names no places. Drive to a pose, in m on the map, instead.")
    known = ", ".join(place.name for place in _nearest_names(wanted, places)[:_LISTED])
    raise Refusal("unknown_place", f"No place called {shown}. Known places: {known}.")


def nearest(pose: Pose, places: TopologicalMap) -> tuple[Place, float] | None:
    """The nearest place in a straight line and its distance in m; None when there are no places."""
    found = [(math.hypot(p.pose.x - pose.x, p.pose.y - pose.y), i) for i, p in enumerate(places.places)]
    if not found:
        return None
    distance, index = min(found)
    return places.places[index], distance


def at_dock(pose: Pose, places: TopologicalMap) -> bool:
    """Whether a pose is that of a dock."""
    return any(
        place.kind == "docking" and math.hypot(place.pose.x - pose.x, place.pose.y - pose.y) <= DOCK_REACH
        for place in places.places
    )


def _key(name: str) -> str:
    """Letters and digits alone: "Lab 2.3.7", "lab2.3.7" and "the lab_2-3-7" are one place."""
    return re.sub(r"[\W_]+", "", re.sub(r"^\s*the\s+", "", name.casefold()))


def _nearest_names(wanted: str, places: TopologicalMap) -> list[Place]:
    def distance(place: Place) -> float:
        return -difflib.SequenceMatcher(None, wanted, _key(place.name)).ratio()

    return sorted(places.places, key=distance)
