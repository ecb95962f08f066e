"""The words that a language model reads: the system message, and the schemas of the agent's own two tools.

The facts in them come from the session and the policy; nothing here decides anything, and no program reads these words
back: a program reads `model.Situation`.
"""

from __future__ import annotations

from typing import Any

from backend.agent.sessions.history import PLAN_TOOL
from backend.agent.turns.model import Situation

_ROLE = """You are {robot}, a mobile robot among people. You act only through your tools, one step at a time, and you \
report what really happened. Look places up with the map before you drive to one. If a person refuses an action, \
respect it, say so, and go on with the rest of the task. If something fails, say what and what could be done. For a \
task of several steps call {plan} first and again whenever a step changes its status; a step that failed stays \
pending. Answer in the language of the person, in short plain sentences, without markup for machines."""

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


def system(situation: Situation) -> str:
    """The system message of a turn."""
    lines = [_ROLE.format(robot=situation.robot, plan=PLAN_TOOL), f"Mode: {situation.mode}. {situation.mode_text}"]
    if situation.asks:
        lines.append(f"Tools that ask a person first: {', '.join(situation.asks)}.")
    if situation.denied:
        lines.append(f"Tools that are not available in this mode: {', '.join(situation.denied)}.")
    if start := situation.start:
        yaw = "" if start.yaw is None else f", yaw={start.yaw}"
        lines.append(f"This session started with the robot at x={start.x}, y={start.y}{yaw} (m, m, rad; map frame).")
    return "\n".join(lines)


def thought(situation: Situation) -> str:
    """The system message for the preliminary thought."""
    return f"{system(situation)}\n{_THOUGHT}"
