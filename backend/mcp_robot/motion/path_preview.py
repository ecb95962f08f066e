"""Who a way that is only computed is drawn for: what a call with `plan_only` says about it in its `_meta`.

A call that says nothing is computed all the same and drawn for nobody. Nothing in here moves anything.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from backend import meta as keys

MAX_ID = 200
"""Letters of an id; none is a slash, as it is part of an address."""


@dataclass(frozen=True)
class Preview:
    """A way to be drawn until it is taken back by its `id`. A `rehearsal` is for people who are about to be asked: it
    is held to all that the drive itself would have to pass at this moment, also where a mere look would not be."""

    id: str
    rehearsal: bool = False


def asked(meta: Mapping[str, Any] | None) -> Preview | None:
    """What a request's `_meta` asks for; None where nothing usable is asked."""
    match (meta or {}).get(keys.PREVIEW):
        case {"id": str(own), **more} if 0 < len(own) <= MAX_ID and "/" not in own:
            return Preview(own, more.get("rehearsal") is True)
    return None
