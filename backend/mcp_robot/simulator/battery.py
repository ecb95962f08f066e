"""The battery: it drains with time and distance, and charges at the dock. Plain arithmetic, time passed in."""

from __future__ import annotations

from dataclasses import dataclass

IDLE_DRAIN = 1 / (8 * 3600)
"""Share of the charge per second: eight hours of standing."""
WAY_DRAIN = 1 / 9000
"""Share of the charge per metre: about nine kilometres."""
CHARGE = 1 / 3600
"""Share of the charge per second at the dock."""


@dataclass(frozen=True)
class Accumulator:
    """Charge from 0 to 1."""

    level: float
    charging: bool = False

    def after(self, dt: float, way: float, *, docked: bool) -> Accumulator:
        """The battery after `dt` s in which the robot drove `way` m."""
        if docked:
            level = min(1.0, self.level + CHARGE * dt)
            return Accumulator(level, charging=level < 1.0)
        return Accumulator(max(0.0, self.level - IDLE_DRAIN * dt - WAY_DRAIN * way))
