"""Finds the place that a person means among the nodes of a topological map, by names alone."""

from __future__ import annotations

import difflib
import json
import math
import re
from dataclasses import dataclass
from typing import Any

_ARTICLE = re.compile(r"^(?:the|a|your|our)\s+", re.I)


@dataclass(frozen=True)
class Node:
    """A named place of the map: `x` and `y` in m, `yaw` in rad, in the map frame."""

    id: str
    name: str
    kind: str
    x: float
    y: float
    yaw: float


def read_map(text: str) -> list[Node]:
    """The nodes in the answer of a map tool. What is no node is left out."""
    try:
        raw = json.loads(text)
    except (ValueError, RecursionError):
        return []
    entries = raw.get("nodes") if isinstance(raw, dict) else None
    return [node for entry in (entries if isinstance(entries, list) else ()) if (node := _node(entry))]


def _node(entry: Any) -> Node | None:
    try:
        where = entry["position"]
        name = str(entry.get("name") or entry["id"])
        yaw = float(where.get("yaw", 0.0))
        x, y = float(where["x"]), float(where["y"])
        if not math.isfinite(x + y + yaw):
            return None  # JSON of some servers has NaN
        return Node(str(entry["id"]), name, str(entry.get("type", "")), x, y, yaw)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        return None


LONGEST_NAME = 200
"""Characters of a place in a person's words; a longer text is compared with no name."""


def find(wanted: str, nodes: list[Node]) -> list[Node]:
    """The nodes that `wanted` can mean: one when its meaning is clear, several to choose from, or none."""
    if len(wanted) > LONGEST_NAME:
        return []
    wanted = _ARTICLE.sub("", wanted.strip())
    key = _key(wanted)
    exact = [n for n in nodes if key in (_key(n.name), _key(n.id))]
    if exact:
        return exact[:1]
    if key in ("home", "charger", "chargingstation", "dock", "dockingstation"):
        return [n for n in nodes if n.kind == "docking"][:1]
    words = _words(wanted)
    return [n for n in nodes if words and _mentions(_words(n.name), words)]


def unknown(wanted: str, nodes: list[Node]) -> str:
    """The sentence for a place that does not exist, the most similar names first."""
    if len(wanted) > LONGEST_NAME:
        wanted = wanted[:LONGEST_NAME] + "…"
    wanted = _ARTICLE.sub("", wanted.strip())
    names = [n.name for n in nodes]
    ranked = sorted(names, key=lambda n: -difflib.SequenceMatcher(None, _key(wanted), _key(n)).ratio())
    return f"No place called {wanted}. Known places: {', '.join(ranked)}."


def _key(text: str) -> str:
    return re.sub(r"[\W_]", "", text.lower())


def _words(text: str) -> list[str]:
    return re.findall(r"[a-z]+|\d+", text.lower())


def _mentions(name: list[str], wanted: list[str]) -> bool:
    """Whether `wanted` can be short for `name`: `name` has all of its words, and either all of its numbers or none.

    "lab 9" is not lab 2.3.9: driving to a guess is worse than asking.
    """
    numbers = [w for w in wanted if w.isdigit()]
    return set(wanted) <= set(name) and (not numbers or numbers == [w for w in name if w.isdigit()])
