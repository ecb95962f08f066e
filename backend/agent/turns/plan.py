"""The plan of a turn as people see it: a step in which a tool call failed is not done.

The model writes the plan, and models like to tick what did not work. So a tick is not taken from the model where the
tool calls say otherwise. ACP knows no failed step: such a step is shown as pending, as ACP's other steps that are not
done. Nothing here runs a tool or decides whether one may run.
"""

from __future__ import annotations

from typing import Any

Entry = dict[str, Any]
"""A step as ACP has it: `content`, `priority` and `status`."""


class Plan:
    """The plan that was shown last in one turn; empty before the first."""

    def __init__(self) -> None:
        self._steps: list[Entry] = []
        self._failed: dict[int, set[str]] = {}
        """What failed and was not made up for, by the number of the step: kinds of tool calls."""

    def revised(self, steps: list[Entry]) -> list[Entry]:
        """The next plan as it is to be shown: no step of it is completed in which something failed."""
        moved = ((self._number_in(steps, old), kinds) for old, kinds in self._failed.items() if kinds)
        self._failed = {number: kinds for number, kinds in moved if number is not None}
        self._steps = [
            step | {"status": "pending"} if number in self._failed and step["status"] == "completed" else step
            for number, step in enumerate(steps)
        ]
        return self._steps

    def call_ended(self, kind: str, *, failed: bool) -> None:
        """Note how a tool call of the present step ended. A later one of the same kind, for instance another drive,
        makes up for it when it succeeds."""
        present = self._present()
        if present is not None:
            kinds = self._failed.setdefault(present, set())
            (kinds.add if failed else kinds.discard)(kind)

    def _present(self) -> int | None:
        """The step in progress, or else the first that is not completed; None without one."""
        for status in ("in_progress", "pending"):
            for number, step in enumerate(self._steps):
                if step["status"] == status and (status == "in_progress" or not self._failed.get(number)):
                    return number
        return None

    def _number_in(self, steps: list[Entry], old: int) -> int | None:
        """The number that the step `old` has in another plan; None where it is gone. A step keeps its number when only
        its words changed."""
        if old < len(steps) and steps[old]["content"] == self._steps[old]["content"]:
            return old
        same = (number for number, step in enumerate(steps) if step["content"] == self._steps[old]["content"])
        return next(same, old if len(steps) == len(self._steps) else None)
