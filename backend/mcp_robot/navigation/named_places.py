"""Finds a place by the name that people give it. Case, spaces and dashes do not matter; two places never match.

Plain functions over the topological map. An ambiguous or unknown name is refused with the nearest known ones.
"""

from __future__ import annotations

import difflib
import math
import re
import unicodedata
from collections.abc import Sequence
from functools import lru_cache

from backend.mcp_robot.refusal import Refusal
from backend.mcp_robot.robot import TopologicalMap
from backend.telemetry import Place, Pose

_LISTED = 14
"""Names that the refusal of an unknown name lists."""
_SHOWN_CHARS = 60
"""Characters of an unknown name that its refusal repeats, and compares with the known ones."""
_SHORTEST_PART = 3
"""Letters and digits that the end of a name needs to stand for the name."""
_CACHED = 4096
"""Names whose comparison is remembered: those of the largest map."""
_ARTICLES = frozenset(["the", "a", "an", "my", "your", "our", "el", "la", "los", "las", "al", "del", "un", "una"])
"""Words that people, or the offline model, put before a name or leave out."""
DOCK_REACH = 0.3
"""A robot this near (m) to a dock's pose stands at it."""


def resolve(name: str, places: TopologicalMap) -> Place:
    """The place of that id or name. Raises `Refusal` (unknown_place) that names those nearest to it."""
    wanted = _keys(name)
    found = [place for place in places.places if wanted & (_keys(place.id) | _keys(place.name))]
    if not found:  # "2.3.7" for "lab 2.3.7", but not for "lab 12.3.7"
        words = _words(_without_article(name))
        if sum(map(len, words)) >= _SHORTEST_PART:
            found = [place for place in places.places if _words(place.name)[-len(words) :] == words]
    if len(found) == 1:
        return found[0]
    shown = "".join(c if c.isprintable() else "\ufffd" for c in name.strip()[:_SHOWN_CHARS]) or "(no name)"
    if not places.places:
        raise Refusal("unknown_place", "This map names no places. Drive to a pose, in m on the map, instead.")
    known = ", ".join(place.name for place in _nearest_names(name, places)[:_LISTED])
    raise Refusal("unknown_place", f"No place called {shown}. Known places: {known}.")


def alike(places: Sequence[tuple[str, str]]) -> tuple[int, int] | None:
    """The indices of two places, given by id and name, that some name means both of: with an article or without, in
    capitals or not, whatever stands between its letters and digits. None when each name means one place."""
    owners: dict[str, int] = {}
    for index, names in enumerate(places):
        for key in frozenset().union(*map(_keys, names)):
            if owners.setdefault(key, index) != index:
                return owners[key], index
    return None


def is_readable(name: str) -> bool:
    """Whether people can read and write a name: it has a letter or a digit, and no control or format character."""
    return bool(_key(name)) and name.isprintable()


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


@lru_cache(_CACHED)
def _keys(name: str) -> frozenset[str]:
    """What a name is compared by: "Lab 2.3.7", "lab2.3.7" and "the lab_2-3-7" are one place."""
    return frozenset(filter(None, (_key(name), _key(_without_article(name)))))


@lru_cache(_CACHED)
def _key(name: str) -> str:
    """Letters and digits alone, with the marks that belong to them: composed and decomposed accents are the same."""
    plain = unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold())
    return "".join(c for c in plain if unicodedata.category(c)[0] in "LMN")


def _without_article(name: str) -> str:
    first = re.match(r"[\W_]*([^\W_]+)[\W_]+(?=[^\W_])", name)
    return name[first.end() :] if first and first[1].casefold() in _ARTICLES else name


def _words(name: str) -> list[str]:
    """The runs of letters and of digits: lab, 2, 3 and 7."""
    return re.findall(r"[^\W\d_]+|\d+", unicodedata.normalize("NFKC", name).casefold())


def _nearest_names(name: str, places: TopologicalMap) -> list[Place]:
    wanted = difflib.SequenceMatcher(b=_key(name[:_SHOWN_CHARS]))  # which prepares its second text

    def distance(place: Place) -> float:
        wanted.set_seq1(_key(place.name))
        return -wanted.ratio()

    return sorted(places.places, key=distance)
