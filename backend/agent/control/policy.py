"""The policy: whether a mode allows a tool, asks a person first, or denies it. The model cannot change it.

`Policy.decide` depends on the tables and on nothing else. A tool that the table names follows the table. Any other tool
follows its MCP annotations, which are hints of its server; a tool without annotations asks. For a visitor the visitors'
table counts, too, and the stricter decision of the two wins. What follows from "ask" is in `permission.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from backend.config import Decision as Decision  # the three words are also those of robot.toml
from backend.identity import Role

Mode = Literal["observe", "plan", "movement", "supervised", "autonomous"]


@dataclass(frozen=True)
class ModeInfo:
    """How a mode is shown to people."""

    id: str
    name: str
    description: str


MODES: tuple[ModeInfo, ...] = (
    ModeInfo("observe", "Observe", "Looks and answers; nothing moves, nothing is said aloud."),
    ModeInfo("plan", "Plan", "Computes paths and shows them; nothing moves."),
    ModeInfo("movement", "Movement", "Drives without asking; says nothing aloud."),
    ModeInfo("supervised", "Supervised", "Drives without asking; asks before it speaks or does anything else."),
    ModeInfo("autonomous", "Autonomous", "Acts without asking."),
)
MODES_IN_ORDER = tuple(mode.id for mode in MODES)
MODE_IDS = frozenset(MODES_IN_ORDER)


def mode_info(mode_id: str) -> ModeInfo:
    """How the mode `mode_id`, which must be one of `MODE_IDS`, is shown to people."""
    return next(mode for mode in MODES if mode.id == mode_id)


_MOTION = ("navigate_to_pose", "navigate_to_place", "rotate_in_place")
_SPEECH = ("speak",)


def _row(motion: Decision, speech: Decision) -> dict[str, Decision]:
    return dict.fromkeys(_MOTION, motion) | dict.fromkeys(_SPEECH, speech)


DEFAULT_TABLE: dict[str, dict[str, Decision]] = {
    "observe": _row("deny", "deny"),
    "plan": _row("deny", "deny"),  # a motion only computes its path: `Policy.previews`
    "movement": _row("allow", "deny"),
    "supervised": _row("allow", "ask"),
    "autonomous": _row("allow", "allow"),
}

_OTHER_ACTING: dict[str, Decision] = {
    "observe": "deny",
    "plan": "deny",
    "movement": "ask",
    "supervised": "ask",
    "autonomous": "allow",
}

_STRICTNESS: tuple[Decision, ...] = ("allow", "ask", "deny")


VISITORS_TABLE: dict[str, Decision] = {
    "navigate_to_place": "allow",
    "rotate_in_place": "allow",
    "navigate_to_pose": "ask",
    "speak": "ask",
}
"""The most that a visitor's prompt may do without a person's permission: driving to places that have a name."""


@dataclass(frozen=True)
class ToolTraits:
    """What the policy knows of a tool. `read_only` is MCP's annotation `readOnlyHint`, None where the tool has none;
    `can_preview` says that the tool can compute its path without moving."""

    name: str
    read_only: bool | None
    can_preview: bool = False


def moves(tool: ToolTraits) -> bool:
    """Whether the tool drives or turns the robot."""
    return tool.name in _MOTION or tool.can_preview


def speaks(tool: ToolTraits) -> bool:
    """Whether the tool says something aloud."""
    return tool.name in _SPEECH


class Policy:
    """The tables of robot.toml over the default ones: mode -> tool -> decision, and for visitors tool -> decision."""

    def __init__(
        self,
        overrides: dict[str, dict[str, Decision]] | None = None,
        visitors: dict[str, Decision] | None = None,
    ) -> None:
        """Raises `ValueError` for a mode that does not exist."""
        overrides = overrides or {}
        if unknown := set(overrides) - MODE_IDS:
            raise ValueError(f"[agent.policy] names no mode {sorted(unknown)[0]!r}; modes: {', '.join(MODES_IN_ORDER)}")
        self._table = {mode: DEFAULT_TABLE[mode] | overrides.get(mode, {}) for mode in MODES_IN_ORDER}
        self._visitors = VISITORS_TABLE | (visitors or {})

    def decide(self, mode: str, tool: ToolTraits, asker: Role, motion_asks: bool = False) -> Decision:
        """Whether `tool` may run in `mode` for a person with the role `asker`.

        `motion_asks` is the session's setting that motion asks where the mode would allow it. It applies to every tool
        that acts and is not known to be speech, because such a tool may move the robot.
        """
        decision = self._by_mode(mode, tool)
        if decision == "allow" and motion_asks and not tool.read_only and not speaks(tool):
            decision = "ask"
        if asker is Role.VISITOR:
            decision = max(decision, self._for_visitors(tool), key=_STRICTNESS.index)
        return decision

    def _for_visitors(self, tool: ToolTraits) -> Decision:
        # A tool that acts and that the table does not name must not be started by a stranger alone.
        return self._visitors.get(tool.name, "allow" if tool.read_only else "ask")

    def _by_mode(self, mode: str, tool: ToolTraits) -> Decision:
        if named := self._table[mode].get(tool.name):
            return named
        if tool.read_only:
            return "allow"
        if tool.read_only is None and mode not in ("observe", "plan"):
            return "ask"  # without an annotation, the tool may do anything
        return _OTHER_ACTING[mode]

    def previews(self, mode: str, tool: ToolTraits) -> bool:
        """Whether `tool` only computes its path in `mode`, and runs without permission because it moves nothing."""
        return mode == "plan" and tool.can_preview
