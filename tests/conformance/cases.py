"""What a conformance case says of itself: which operations, notifications and updates of the protocol it shows.

The claim is kept on the function; the `client` fixture checks it against the frames of the case, so a case cannot claim
what it does not do.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from tests.conformance.schema import Frame, Sender

UNKNOWN = "an unknown method"
NO_TERMINAL = "terminal/… is never asked for"

Case = TypeVar("Case", bound=Callable[..., Any])


def shows(*operations: str) -> Callable[[Case], Case]:
    """Marks a case. An operation is a method, `session/update KIND`, `available command /NAME` and so on."""

    def mark(case: Case) -> Case:
        case.__dict__["operations"] = operations
        return case

    return mark


def operations_of(case: Callable[..., Any]) -> tuple[str, ...]:
    """What a case says that it shows."""
    return tuple(case.__dict__.get("operations", ()))


def seen_in(log: list[tuple[Sender, Frame]]) -> set[str]:
    """The operations that a log shows; a request counts only where it was answered with a result."""
    answered = {(sender, repr(frame["id"])) for sender, frame in log if "result" in frame}
    seen = set()
    for sender, frame in log:
        method = frame.get("method")
        receiver: Sender = "agent" if sender == "client" else "client"
        if "error" in frame and sender == "agent" and frame["error"]["code"] == -32601:
            seen.add(UNKNOWN)
        if method is None or ("id" in frame and (receiver, repr(frame["id"])) not in answered):
            continue
        seen |= {method} | _details(method, frame.get("params", {}), receiver)
    asked = {frame["method"] for sender, frame in log if sender == "agent" and "id" in frame and "method" in frame}
    return seen if any(method.startswith("terminal/") for method in asked) else seen | {NO_TERMINAL}


def _details(method: str, params: dict[str, Any], receiver: Sender) -> set[str]:
    match method:
        case "session/update":
            return {f"session/update {params['update']['sessionUpdate']}"}
        case "session/set_config_option":
            return {f"session/set_config_option {params['configId']}"}
        case "session/prompt":
            texts = [block["text"] for block in params["prompt"] if block["type"] == "text"]
            blocks = {f"session/prompt {block['type']}" for block in params["prompt"]}
            return blocks | {f"available command {text}" for text in texts if text.startswith("/")}
        case "$/cancel_request":
            return {f"$/cancel_request to the {receiver}"}
        case _:
            return set()
