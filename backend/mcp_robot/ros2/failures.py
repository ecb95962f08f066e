"""Nav2's error codes as refusals with a sentence for a person or an LLM. A table and three functions."""

from __future__ import annotations

from typing import Any

from backend.mcp_robot.refusal import Code, Refusal

# nav2_msgs, Iron to Kilted: 10x following, 20x planning, 70x turning, 900x the navigator itself.
_MEANING: dict[int, tuple[Code, str]] = {
    102: ("lost", "the transform of the robot was lost. Wait for its localisation, or set its pose anew"),
    104: ("blocked", "the way stayed blocked. Look what is in the way, then ask again"),
    105: ("blocked", "the robot got no further. Look what is in the way, then ask again"),
    106: ("blocked", "no safe movement was left. Look what is in the way, then ask again"),
    203: ("lost", "the transform of the robot was lost. Wait for its localisation, or set its pose anew"),
    204: ("lost", "the robot believes to be outside of the map. Set its pose anew"),
    205: ("outside_map", "the goal is outside of the planner's map. Choose another goal"),
    206: ("blocked", "the robot stands on what its planner takes for occupied. Somebody has to clear its surroundings"),
    207: ("occupied", "the planner takes the goal for occupied. Choose another goal"),
    208: ("timeout", "planning took too long. Choose a nearer goal, or try again"),
    209: ("unreachable", "no path leads there. Choose another goal"),
    701: ("timeout", "the turn took too long. Look what is in the way, then ask again"),
    702: ("lost", "the transform of the robot was lost. Wait for its localisation, or set its pose anew"),
    703: ("blocked", "something is too near to turn. Look what is in the way, then ask again"),
    9002: ("lost", "the transform of the robot was lost. Wait for its localisation, or set its pose anew"),
    9003: ("timeout", "the drive took too long. Look what is in the way, then ask again"),
}


def without_reason(result: Any) -> bool:
    """Whether an action was aborted without a reason, as Nav2's servers abort a goal when a newer one comes. Humble's
    results have no error code: there every failure looks like this."""
    return not int(getattr(result, "error_code", 0))


def aborted(name: str, result: Any) -> Refusal:
    """The refusal for an action that was aborted. Humble's results have no error code, so there it is `nav_failed`."""
    number = int(getattr(result, "error_code", 0))
    said = str(getattr(result, "error_msg", "")).strip()[:200]
    detail = f" ({said})" if said else ""
    if number in _MEANING:
        code, sentence = _MEANING[number]
        return Refusal(code, f"{name} gave up{detail}: {sentence}.")
    with_number = f" with error {number}" if number else ""
    sentence = "Look what is in the way and at Nav2's log, then ask again."
    return Refusal("nav_failed", f"{name} gave up{with_number}{detail}, or another client took over. {sentence}")


def cancelled(name: str) -> Refusal:
    """The refusal for a motion that another client cancelled."""
    return Refusal("nav_failed", f"Another client of {name} cancelled the motion. Ask again when the robot is free.")
