"""Where the robot has been: points at equal distances, in a ring buffer of short pieces.

Only the newest piece grows, so the cost of a step does not depend on the trail's length. Plain data, without viser.
"""

from __future__ import annotations

import math

from backend.telemetry import Pose

STEP = 0.25
"""m between two points."""
JUMP = 1.5
"""m that no robot drives between two states: it was carried elsewhere, or was disconnected for a while."""
PIECES = 24
POINTS_PER_PIECE = 40

Point = tuple[float, float]


class Trail:
    """About the last 240 m. `pieces[i]` are the points of piece i; it begins where the piece before it ends."""

    def __init__(self) -> None:
        self.pieces: list[list[Point]] = [[] for _ in range(PIECES)]
        self._newest = 0  # the piece that grows

    def clear(self) -> None:
        """Forget all points: another map has other coordinates."""
        for piece in self.pieces:
            piece.clear()

    def add(self, pose: Pose) -> int | None:
        """The robot is at `pose`. Returns the index of the piece that has changed, None where none has."""
        here = (pose.x, pose.y)
        piece = self.pieces[self._newest]
        if not piece:
            piece.append(here)
            return None
        distance = math.dist(piece[-1], here)
        if distance < STEP:
            return None
        if distance > JUMP or len(piece) == POINTS_PER_PIECE:
            self._newest = (self._newest + 1) % PIECES
            self.pieces[self._newest] = [here] if distance > JUMP else [piece[-1], here]
        else:
            piece.append(here)
        return self._newest
