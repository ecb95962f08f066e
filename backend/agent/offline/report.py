"""The sentences that the offline model says: what it will do, what happened, what people can ask for."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from typing import Any

from backend.agent.offline.grammar import (
    Action,
    GoBack,
    GoTo,
    GoToPoint,
    Say,
    TakePhoto,
    TellAbilities,
    TellBattery,
    TellPlaces,
    TellPose,
    Turn,
)

_LARGEST = 1e12
_SPEECH = re.compile(r"speak|say|announce|talk|tts", re.I)


def help_text(abilities: list[str]) -> str:
    """The answer to “what can you do?”, with one line for each of `abilities`."""
    listed = "\n".join(f"- {ability}" for ability in abilities)
    follow = "Steps can follow each other: “go to …, say …, then come back”."
    return f"I am no language model, only a small set of commands. I can:\n\n{listed}\n\n{follow}"


def intention(actions: list[Action], asks: Sequence[str]) -> str:
    """One sentence that announces the actions; `asks` names the tools that a person must allow first."""
    if not actions:
        return "I will tell you what I can do."
    asking = any(_SPEECH.search(name) for name in asks)
    parts: list[str] = []
    for action in actions:
        parts += _intended(action, asking)
    parts = list(dict.fromkeys(parts))
    head, last = ", ".join(parts[:-1]), parts[-1]
    return f"I will {head}{',' if len(parts) > 2 else ''} and {last}." if head else f"I will {last}."


def _intended(action: Action, asking: bool) -> list[str]:
    match action:
        case GoTo(place):
            return [f"look {place} up", "drive there"]
        case GoToPoint(x, y):
            return [f"drive to x {x:g} m, y {y:g} m"]
        case GoBack():
            return ["drive back to where this session started"]
        case Say(text):
            return ["ask before I speak"] if asking else [f"say “{text}”"]
        case Turn(degrees):
            return [f"turn {_turned(degrees)}"]
        case TakePhoto():
            return ["take a photo"]
        case TellBattery():
            return ["look at the battery"]
        case TellPose():
            return ["look where I am"]
        case TellPlaces():
            return ["read the map"]
        case TellAbilities():
            return ["tell you what I can do"]


def plan_entry(action: Action) -> str:
    """An action as one line of a plan."""
    match action:
        case GoTo(place):
            return f"Go to {place}"
        case GoToPoint(x, y):
            return f"Go to x {x:g} m, y {y:g} m"
        case GoBack():
            return "Go back to where this session started"
        case Say(text):
            return f"Say: {text}"
        case Turn(degrees):
            return f"Turn {_turned(degrees)}"
        case TakePhoto():
            return "Take a photo"
        case TellBattery():
            return "Look at the battery"
        case TellPose():
            return "Look where I am"
        case TellPlaces():
            return "Tell the places"
        case TellAbilities():
            return "Tell what I can do"


def impossible(action: Action) -> str:
    """The sentence about an action that no tool can do."""
    if isinstance(action, GoBack):
        return "I do not know where this session started, so I cannot go back. Tell me a place instead."
    return f"I have no tool for this: {plan_entry(action)}."


def left_out(actions: list[Action]) -> list[str]:
    """The sentence about the actions that were left out because an earlier one failed; none without actions."""
    if not actions:
        return []
    return ["So I left out the rest: " + "; ".join(plan_entry(a).rstrip(".") for a in actions) + "."]


def outcome(action: Action, result: str, failed: bool) -> str:
    """The sentence about an action whose tool call has ended with `result`."""
    if failed:
        return _failure(action, reason(result))
    data = _data(result)
    match action:
        case GoTo() | GoToPoint() | GoBack() if data.get("reached") is False:
            length = _number(data.get("path_length"))
            return f"The path is {length:.1f} m long. I did not move." if length is not None else "I did not move."
        case GoTo(place):
            named = str(data.get("place") or place)
            return f"I am at {place if named.lower() in place.lower() else named}."
        case GoToPoint(x, y):
            return f"I am at x {x:g} m, y {y:g} m."
        case GoBack():
            return "I am back where this session started."
        case Say(text):
            return f"I said: “{text}”"
        case Turn(degrees):
            return f"I turned {_turned(degrees)}."
        case TakePhoto():
            return "Here is what I see."
        case TellBattery():
            return _battery(data)
        case TellPose():
            return _pose(data)
        case TellPlaces() | TellAbilities():
            return ""


def chosen(result: str) -> str | None:
    """The option that a person chose, from the result of the tool that asks; None when nobody chose."""
    answer = _data(result).get("answer")
    return answer if isinstance(answer, str) else None


def reason(result: str) -> str:
    """An error as a sentence, without the prefix and the code that programs read."""
    return re.sub(r"^Error: (?:[a-z_]+: )?", "", result)


def _failure(action: Action, why: str) -> str:
    match action:
        case Say(text):
            return f"I did not say “{text}”: {why}" + ("" if why.endswith(".") else ".")
        case GoTo() | GoToPoint() | GoBack():
            return f"I did not get there. {why}"
        case _:
            return f"{plan_entry(action)} did not work. {why}"


def _turned(degrees: float) -> str:
    return f"{'left' if degrees >= 0 else 'right'} by {abs(degrees):g}°"


def _battery(data: dict[str, Any]) -> str:
    level = _number(data.get("battery"))
    if level is None:
        return "My status: " + json.dumps(data, ensure_ascii=False)
    return f"The battery is at {level:.0%}" + (" and charging." if data.get("charging") else ".")


def _pose(data: dict[str, Any]) -> str:
    x, y, yaw = (_number(data.get(name)) for name in ("x", "y", "yaw"))
    if x is None or y is None:
        return "My position: " + json.dumps(data, ensure_ascii=False)
    near = f", near {data['nearest_place']}" if data.get("nearest_place") else ""
    facing = f", facing {math.degrees(yaw):.0f}°" if yaw is not None else ""
    return f"I am at x {x:.1f} m, y {y:.1f} m{facing}{near}."


def _number(value: object) -> float | None:
    """A number of a robot whose results are not ours: None for every other value, and for one without a size."""
    known = isinstance(value, int | float) and abs(value) < _LARGEST
    return float(value) if known else None  # type: ignore[arg-type] # `known` has checked it


def _data(result: str) -> dict[str, Any]:
    try:
        data = json.loads(result)
    except (ValueError, RecursionError):
        return {}
    return data if isinstance(data, dict) else {}
