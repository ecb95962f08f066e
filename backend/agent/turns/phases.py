"""What a turn spends its time on, in the phases of the paper's latency table: the turn tells what begins and ends.

Every moment counts for one phase, so that the phases add up to the turn. Only measures: no decision may hang on it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Literal

from backend.agent.control.policy import ToolTraits, moves, speaks

Phase = Literal["thought", "inference", "navigation", "speech", "tools", "person", "waiting"]

PHASES: tuple[Phase, ...] = ("thought", "inference", "navigation", "speech", "tools", "person", "waiting")
"""The order is a rule, too: of two that go on side by side the first one counts. So the first inference, which runs
beside the preliminary thought, counts from the moment when the thought is out: until then it costs nobody any time."""

REST = "protocols"
"""All that is none of the phases: frames, the log, connecting to servers."""


def phase_of(tool: ToolTraits, looks: bool) -> Phase:
    """What a call of the tool counts as; one that only looks, as a mere preview of a path does, drives nowhere."""
    if looks:
        return "tools"
    return "navigation" if moves(tool) else "speech" if speaks(tool) else "tools"


class Phases:
    """The stop-watch of one turn; it runs from the moment it is made. `clock` gives seconds."""

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
