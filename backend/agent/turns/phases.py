"""Measures the time of a turn by phase, in the phases of the paper's latency table.

The turn marks where a phase begins and ends. Every moment counts for one phase, so the phases add up to the turn. No
decision may depend on these figures.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Literal

from backend.agent.control.policy import ToolTraits, moves, speaks

Phase = Literal["thought", "inference", "navigation", "speech", "tools", "person", "waiting"]

PHASES: tuple[Phase, ...] = ("thought", "inference", "navigation", "speech", "tools", "person", "waiting")
"""In the order of precedence: while two phases run side by side, the time counts for the one that comes first here. So
the first inference, which runs beside the preliminary thought, counts only from the end of the thought."""

REST = "protocols"
"""The name for the rest of the time: frames, the log, connecting to servers."""


def phase_of(tool: ToolTraits, looks: bool) -> Phase:
    """The phase that a call of the tool counts for. `looks`: the call only reads, or only previews a path."""
    if looks:
        return "tools"
    return "navigation" if moves(tool) else "speech" if speaks(tool) else "tools"


class Phases:
    """The stopwatch of one turn. It runs from its construction; `clock` returns seconds."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._since = clock()
        self._spent: dict[str, float] = dict.fromkeys((*PHASES, REST), 0.0)
        self._active: list[Phase] = []

    @contextmanager
    def during(self, phase: Phase) -> Iterator[None]:
        """Count the time of the block as `phase`."""
        self._charge()
        self._active.append(phase)
        try:
            yield
        finally:
            self._charge()
            self._active.remove(phase)

    def seconds(self) -> dict[str, float]:
        """The seconds so far, by phase, with their sum as `total`."""
        self._charge()
        spent = {phase: round(seconds, 4) for phase, seconds in self._spent.items()}
        return spent | {"total": round(sum(spent.values()), 4)}

    def _charge(self) -> None:
        now = self._clock()
        self._spent[min(self._active, key=PHASES.index, default=REST)] += now - self._since
        self._since = now
