"""For whom a path is drawn that was only computed.

Nothing in here moves anything.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PathPreview:
    """A computed path that telemetry shows until somebody withdraws it by its `id`.

    A `rehearsal` is for people who are about to be asked for permission: it has to pass every rule that the drive
    itself would have to pass at this moment. Any other preview has to pass the rules for goal and path alone.
    """

    id: str
    rehearsal: bool = False
