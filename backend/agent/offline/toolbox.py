"""Finds the tool of an unknown robot for an action, by the names and parameters in the tool list."""

from __future__ import annotations

import re
from typing import Any


class Toolbox:
    """The tools of one inference. Each method returns a call, as name and arguments, or None when no tool fits."""

    def __init__(self, tools: list[dict[str, Any]]) -> None:
        self._functions = [tool["function"] for tool in tools]

    def has(self, name: str) -> bool:
        """Whether there is a tool of exactly this name."""
        return any(f["name"] == name for f in self._functions)

    def drive_to_place(self, name: str, x: float, y: float, yaw: float) -> tuple[str, dict[str, Any]] | None:
        """A call that drives to a named place, by its name where a tool takes one, else by its coordinates."""
        for function in self._named(r"navigate|go_?to|drive|move_?to|visit"):
            if parameter := self._parameter(function, "string"):
                return function["name"], {parameter: name}
        return self.drive_to_point(x, y, yaw)

    def drive_to_point(self, x: float, y: float, yaw: float | None) -> tuple[str, dict[str, Any]] | None:
        """A call that drives to a point in the map frame, in m and rad."""
        for function in self._named(r"navigate|go_?to|drive|move"):
            known = function["parameters"].get("properties", {})
            if {"x", "y"} <= known.keys():
                heading = {"yaw": yaw} if yaw is not None and "yaw" in known else {}
                return function["name"], {"x": x, "y": y} | heading
        return None

    def turn(self, degrees: float) -> tuple[str, dict[str, Any]] | None:
        """A call that turns on the spot, left positive."""
        return self._with(r"rotate|turn|spin", "number", degrees)

    def say(self, text: str) -> tuple[str, dict[str, Any]] | None:
        """A call that speaks."""
        return self._with(r"speak|say|announce|talk|tts", "string", text)

    def photo(self) -> tuple[str, dict[str, Any]] | None:
        """A call that takes a picture."""
        return self._without(r"photo|picture|camera|image|snapshot")

    def map(self) -> tuple[str, dict[str, Any]] | None:
        """A call that reads the topological map."""
        return self._without(r"topolog|(?:get|list|read)_?(?:map|places|rooms)")

    def pose(self) -> tuple[str, dict[str, Any]] | None:
        """A call that reports the robot's pose."""
        return self._without(r"pose|position|where|localization")

    def status(self) -> tuple[str, dict[str, Any]] | None:
        """A call that reports the battery's charge."""
        return self._without(r"battery|status|state")

    def abilities(self) -> list[str]:
        """What can be asked for with these tools, as examples for people."""
        examples = [
            (self.drive_to_place("", 0, 0, 0), "drive (“go to …”, “come back”)"),
            (self.say(""), "speak (“say …”, “tell them that …”)"),
            (self.turn(0), "turn (“turn left by 90 degrees”)"),
            (self.photo(), "take a photo (“what do you see?”)"),
            (self.status(), "tell the battery (“how is the battery?”)"),
            (self.pose(), "tell where I am (“where are you?”)"),
            (self.map(), "list the places I know (“which places are there?”)"),
        ]
        return [text for call, text in examples if call]

    def _named(self, pattern: str) -> list[dict[str, Any]]:
        return [f for f in self._functions if re.search(pattern, f["name"], re.I)]

    def _parameter(self, function: dict[str, Any], kind: str) -> str | None:
        """The parameter of this JSON type that must be given, else the first one of that type."""
        schema = function["parameters"]
        known = schema.get("properties", {})
        fitting: list[str] = [
            n for n, p in known.items() if p.get("type") in (kind, "integer" if kind == "number" else kind)
        ]
        required = [n for n in fitting if n in schema.get("required", [])]
        return next(iter(required or fitting), None)

    def _with(self, pattern: str, kind: str, value: object) -> tuple[str, dict[str, Any]] | None:
        for function in self._named(pattern):
            if parameter := self._parameter(function, kind):
                return function["name"], {parameter: value}
        return None

    def _without(self, pattern: str) -> tuple[str, dict[str, Any]] | None:
        for function in self._named(pattern):
            if not function["parameters"].get("required"):
                return function["name"], {}
        return None
