"""The texts that the model is given: who it is, where the session began, what the mode lets it do.

Facts come from the session and the policy; nothing here decides anything.
"""

from __future__ import annotations

from typing import Any

from backend.agent.sessions.history import PLAN_TOOL

_ROLE = """You are {robot}, a mobile robot among people. You act only through your tools, one step at a time, and you \
report what really happened. Look places up with the map before you drive to one. If a person refuses an action, \
respect it, say so, and go on with the rest of the task. If something fails, say what and what could be done. For a \
task of several steps call {plan} first and again whenever a step changes its status. Answer in the language of the \
person, in short plain sentences, without markup for machines."""

_THOUGHT = """Reply with one short sentence in the first person, in the language of the person: what you are about to \
do about the last message. Do not do it yet, and do not claim to have done it."""

PLAN_TOOL_SCHEMA: dict[str, Any] = {
    "type": "function",
    "function": {
        "name": PLAN_TOOL,
        "description": "Show people the steps of the task and how far you are. Moves nothing.",
        "parameters": {
            "type": "object",
            "required": ["entries"],
            "properties": {
                "entries": {
                    "type": "array",
                    "items": {
                        "type": "object",
                        "required": ["content", "status"],
                        "properties": {
                            "content": {"type": "string"},
                            "status": {"type": "string", "enum": ["pending", "in_progress", "completed"]},
                        },
                    },
                }
            },
        },
    },
}

ASK_TOOL = "ask_person"
ASK_TOOL_SCHEMA: dict[str, Any] = {
    "type": "function",
    "function": {
        "name": ASK_TOOL,
        "description": "Let the person choose when a request can mean several things. Do not ask what you can look up.",
        "parameters": {
            "type": "object",
            "required": ["question", "options"],
            "properties": {
                "question": {"type": "string"},
                "options": {"type": "array", "items": {"type": "string"}, "minItems": 2},
            },
        },
    },
}


def system(
    robot: str,
    mode: str,
    mode_text: str,
    asks: list[str],
    denied: list[str],
    start_pose: dict[str, Any] | None,
) -> str:
    """The system message of a turn. `asks` and `denied` are names of tools."""
    lines = [_ROLE.format(robot=robot, plan=PLAN_TOOL), f"Mode: {mode}. {mode_text}"]
    if asks:
        lines.append(f"Tools that ask a person first: {', '.join(asks)}.")
    if denied:
        lines.append(f"Tools that are not available in this mode: {', '.join(denied)}.")
    if start_pose:
        where = ", ".join(f"{key}={start_pose[key]}" for key in ("x", "y", "yaw") if key in start_pose)
        lines.append(f"This session started with the robot at {where} (m, m, rad; map frame).")
    return "\n".join(lines)


def thought(system_text: str) -> str:
    """The system message for the preliminary thought."""
    return f"{system_text}\n{_THOUGHT}"
