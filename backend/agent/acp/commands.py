"""The slash commands, which need no language model. The policy applies to them as to everything else.

The agent carries out `/stop` and `/export` itself. The offline model carries out the others, whichever model the
session has.
"""

from __future__ import annotations

from typing import Any

_COMMANDS = {
    "stop": "Stop the robot at once; a supervisor releases it.",
    "home": "Drive back to where this session started.",
    "where": "Tell where the robot is.",
    "battery": "Tell the charge of the battery.",
    "photo": "Take a photo and show it.",
    "places": "List the places that the robot knows.",
    "export": "Hand over the log of this session as a file.",
}


def available() -> list[dict[str, Any]]:
    """The commands as ACP publishes them."""
    return [{"name": name, "description": description} for name, description in _COMMANDS.items()]


def named_in(prompt: list[dict[str, Any]]) -> str | None:
    """The name of the command that is the whole prompt; None when the prompt is no command."""
    if len(prompt) != 1 or prompt[0].get("type") != "text":
        return None
    text = prompt[0]["text"].strip().lower()
    name = text.removeprefix("/")
    return name if text.startswith("/") and name in _COMMANDS else None
