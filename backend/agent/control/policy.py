"""What a mode lets a tool do: allow, ask a person first, or deny. Deterministic; the model cannot change it.

THE PERMISSION RULE is `decide`, and it is the only one. A tool that the table names follows the table; any
other is judged by its MCP annotations, which are hints of the robot server; one without annotations asks. What a
visitor asks for passes the visitors' table, too, and the stricter of the two counts.
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
MODE_IDS = frozenset(mode.id for mode in MODES)

_MOTION = ("navigate_to_pose", "navigate_to_place", "rotate_in_place")
_SPEECH = ("speak",)


def _row(motion: Decision, speech: Decision) -> dict[str, Decision]:
    return dict.fromkeys(_MOTION, motion) | dict.fromkeys(_SPEECH, speech)


DEFAULT_TABLE: dict[str, dict[str, Decision]] = {
    "observe": _row("deny", "deny"),
    "plan": _row("deny", "deny"),  # motion still computes its path: see `previews`
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
"""What a visitor's prompt may set off, at most: driving to places with a name."""


@dataclass(frozen=True)
class ToolTraits:
    """What policy needs to know of a tool: its name, and what its annotations say (None: they say nothing)."""

    name: str
    read_only: bool | None
    can_preview: bool = False


def moves(tool: ToolTraits) -> bool:
    """Whether the tool is one of those that drive or turn the robot."""
    return tool.name in _MOTION or tool.can_preview


def speaks(tool: ToolTraits) -> bool:
    """Whether the tool is one of those that say something aloud."""
    return tool.name in _SPEECH


class Policy:
    """The tables of robot.toml over the defaults: mode -> tool -> decision, and for visitors tool -> decision."""

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
        """Whether `tool` may run in `mode` for `asker`; `motion_asks` is a session's wish that motion asks where it
        is free: of a tool that acts and is not known to speak, nobody knows that it moves nothing."""
        decision = self._by_mode(mode, tool)
        if decision == "allow" and motion_asks and not tool.read_only and not speaks(tool):
            decision = "ask"
        if asker is Role.VISITOR:
            decision = max(decision, self._for_visitors(tool), key=_STRICTNESS.index)
        return decision

    def _for_visitors(self, tool: ToolTraits) -> Decision:
        # What nobody thought of when the table was written, and acts, is not a stranger's to start.
        return self._visitors.get(tool.name, "allow" if tool.read_only else "ask")

    def _by_mode(self, mode: str, tool: ToolTraits) -> Decision:
        if named := self._table[mode].get(tool.name):
            return named
        if tool.read_only:
            return "allow"
        if tool.read_only is None and mode not in ("observe", "plan"):
            return "ask"  # it says nothing of itself: it may do anything
        return _OTHER_ACTING[mode]

    def previews(self, mode: str, tool: ToolTraits) -> bool:
        """Whether `tool` runs as a mere computation of its path in `mode`."""
        return mode == "plan" and tool.can_preview


MODES_IN_ORDER = tuple(mode.id for mode in MODES)
