"""Writes docs/conformance.md: each operation of the protocol, the case that shows it, the transports it runs on.

`python -m tests.conformance.table` writes it anew from the cases; a test compares. No row is kept by hand.
"""

from __future__ import annotations

import importlib
import inspect
import re
from collections import defaultdict
from pathlib import Path
from types import ModuleType

from tests.conformance.cases import operations_of
from tests.conformance.channels import TRANSPORTS

DOCUMENT = Path(__file__).parents[2] / "docs/conformance.md"
MODULES = ("test_connection", "test_sessions", "test_turns")

_HEAD = """# ACP conformance

For people who want to know which operations of ACP the agent has, and which test shows each of them. This page is
written by `python -m tests.conformance.table` from the cases in `tests/conformance/`; a test fails when the two differ.

Each case drives the real agent, with the real robot server under it, once on each transport. Every frame in both
directions is validated against the JSON schema of `@agentclientprotocol/sdk`. A case fails when the wire does not show
the operation that the case names here. Methods that begin with `_` are extensions ([extensions.md](extensions.md)).
`session/set_model` has left the protocol and stays for older clients.

| operation | case | transports |
|---|---|---|
"""


def cases(module: ModuleType) -> list[tuple[str, tuple[str, ...]]]:
    """The cases of a test module with what they show, in the order of the file."""
    functions = [f for name, f in inspect.getmembers(module, inspect.isfunction) if name.startswith("test_")]
    functions = [function for function in functions if function.__module__ == module.__name__]
    functions.sort(key=lambda function: inspect.getsourcelines(function)[1])
    return [(function.__name__, operations_of(function)) for function in functions]


def rendered() -> str:
    """The whole document."""
    shown: dict[str, list[str]] = defaultdict(list)
    for name in MODULES:
        for case, operations in cases(importlib.import_module(f"tests.conformance.{name}")):
            for operation in operations:
                shown[operation].append(f"`{name}.py`: {case}")
    everywhere = ", ".join(TRANSPORTS.values())
    rows = [f"| {_code(what)} | {'<br>'.join(shown[what])} | {everywhere} |" for what in sorted(shown, key=_order)]
    return _HEAD + "\n".join(rows) + "\n"


def _order(operation: str) -> tuple[bool, bool, str]:
    """The protocol's own first, then our extensions, then what is not there."""
    return " " in operation and not re.match(r"session/|available|\$", operation), operation.startswith("_"), operation


def _code(operation: str) -> str:
    """An operation with its method as code."""
    if match := re.fullmatch(r"(available command|an unknown method)( /\w+)?", operation):
        return match[1] + (f" `{match[2].strip()}`" if match[2] else "")
    method, _, rest = operation.partition(" ")
    if not rest or re.match(r"(to|is) ", rest):
        return f"`{method}` {rest}".strip()
    return f"`{method}`: `{rest}`"


if __name__ == "__main__":
    DOCUMENT.write_text(rendered())
