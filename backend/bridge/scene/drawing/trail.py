"""Where the robot has been: points at steady distances, in a ring of short pieces, the oldest of which is forgotten.

Only one piece grows, so what a step costs does not depend on how long the trail is. Plain data, without viser.
"""

from __future__ import annotations

import math

from backend.telemetry import Pose

STEP = 0.25
"""m between two points."""
JUMP = 1.5
"""m that no robot drives between two states: it was set down elsewhere, or was not heard of for a while."""
PIECES = 24
PIECE_POINTS = 40

Point = tuple[float, float]


class Trail:
    """The last 240 m or so. `pieces[i]` are the points of the piece i, joined to those of the piece before."""

    def __init__(self) -> None:
        self.pieces: list[list[Point]] = [[] for _ in range(PIECES)]
        self._growing = 0

    def clear(self) -> None:
        """Forget everything: another map has other coordinates."""
        for piece in self.pieces:
            piece.clear()

    def follow(self, pose: Pose) -> int | None:
        """Take in where the robot is; the piece that has changed, if one has."""
        here = (pose.x, pose.y)
        piece = self.pieces[self._growing]
        if not piece:
            piece.append(here)
            return None
        distance = math.dist(piece[-1], here)
        if distance < STEP:
            return None
        if distance > JUMP or len(piece) == PIECE_POINTS:
            self._growing = (self._growing + 1) % PIECES
            self.pieces[self._growing] = [here] if distance > JUMP else [piece[-1], here]
        else:
            piece.append(here)
        return self._growing
