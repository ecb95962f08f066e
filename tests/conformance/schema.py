"""Judges JSON-RPC frames against the JSON schema that the official npm SDK ships.

It looks and remembers; it never changes a frame, and it is no part of the agent. What the stable schema of version 1
does not know is looked up in the unstable one. Methods that begin with `_` are ours: their params and results are
objects. `session/set_model` has been dropped from the protocol, so the schema says nothing of it: objects as well.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal

from jsonschema import Draft202012Validator
from jsonschema.protocols import Validator

Sender = Literal["client", "agent"]
Frame = dict[str, Any]

FOLDER = Path(__file__).parents[2] / "web/node_modules/@agentclientprotocol/sdk/schema/v1"
STABLE, UNSTABLE = "schema.json", "schema.unstable.json"
DROPPED = frozenset({"session/set_model"})
_OTHER: dict[Sender, Sender] = {"client": "agent", "agent": "client"}


@cache
def _document(name: str) -> dict[str, Any]:
    return dict(json.loads((FOLDER / name).read_text()))


@cache
def _definition(kind: str, method: str, receiver: Sender) -> tuple[str, str] | None:
    """The file and the name of the definition of a method's params (Request, Notification) or result (Response)."""
    for name in (STABLE, UNSTABLE):
        for title, definition in _document(name)["$defs"].items():
            sides = (receiver, "protocol")
            if definition.get("x-method") == method and definition.get("x-side") in sides and title.endswith(kind):
                return name, title
    return None


@cache
def _validator(file: str, title: str) -> Validator:
    document = _document(file)
    return Draft202012Validator(
        {"$schema": document["$schema"], "$defs": document["$defs"], "$ref": f"#/$defs/{title}"}
    )


def _against(file: str, title: str, value: Any) -> list[str]:
    found = _validator(file, title).iter_errors(value)
    return [f"{title}{error.json_path[1:]}: {error.message[:300]}" for error in found]


@dataclass
class Judge:
    """Sees every frame of one connection, in order, and keeps what is wrong with them."""

    violations: list[str] = field(default_factory=list)
    _asked: dict[tuple[Sender, str], str] = field(default_factory=dict)
    """Who asked under which id, with the method; until it is answered."""

    def see(self, sender: Sender, frame: Frame) -> None:
        """Judge one frame."""
        wrong = self._wrong(sender, frame)
        self.violations += [f"{sender}: {what} in {json.dumps(frame)[:500]}" for what in wrong]

    def _wrong(self, sender: Sender, frame: Frame) -> list[str]:
        if frame.get("jsonrpc") != "2.0":
            return ["the JSON-RPC version"]
        wrong = _against(STABLE, "RequestId", frame["id"]) if "id" in frame else []
        if "method" not in frame:
            return wrong + self._wrong_response(sender, frame)
        kind = "Request" if "id" in frame else "Notification"
        if "id" in frame:
            self._asked[sender, repr(frame["id"])] = frame["method"]
        return wrong + _wrong_content(kind, frame["method"], _OTHER[sender], frame.get("params", {}))

    def _wrong_response(self, sender: Sender, frame: Frame) -> list[str]:
        method = self._asked.pop((_OTHER[sender], repr(frame.get("id"))), None)
        if method is None:
            return ["an answer to nothing"]
        if ("result" in frame) == ("error" in frame):
            return ["neither a result nor an error, or both"]
        if "error" in frame:
            return _against(STABLE, "Error", frame["error"])
        return _wrong_content("Response", method, sender, frame["result"])


def _wrong_content(kind: str, method: str, side: Sender, value: Any) -> list[str]:
    if method.startswith("_") or method in DROPPED:
        return [] if isinstance(value, dict) else [f"{method}: no object"]
    found = _definition(kind, method, side)
    return [f"{method}: the schema has no such {kind.lower()}"] if found is None else _against(*found, value)
