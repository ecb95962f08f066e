"""The activities of the simulated robot: driving along a track, turning on the spot, speaking. Data, no behaviour."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from backend.mcp_robot.navigation.follower import Track

Outcome = Literal["running", "reached", "blocked", "halted"]


@dataclass
class Drive:
    """Driving along a track, which is replaced when the way is blocked. `along` m of it are done.

    The robot has stood before something for `waiting` s, made no progress for `stalled` s whatever the reason, and seen
    something on the path ahead for `obstructed` s. It has asked for another path `rerouted` times.
    """

    track: Track
    along: float = 0.0
    waiting: float = 0.0
    stalled: float = 0.0
    obstructed: float = 0.0
    rerouted: int = 0
    outcome: Outcome = "running"


@dataclass
class Turn:
    """Turning on the spot; `left` rad are to go, counter-clockwise positive."""

    left: float
    outcome: Outcome = "running"


@dataclass
class Utterance:
    """Speaking; `left` s are to go."""

    left: float
    outcome: Outcome = "running"
