"""Asks a person a question with a few options, as ACP's form elicitation.

The question settles what is ambiguous. It must never stand for a permission: the answer allows no tool call. But the
answer can decide where the robot drives, so the question goes to the person who asked for the turn or to one who may
approve, never to one who only watches.
"""

from __future__ import annotations

import asyncio
from typing import Any

from acp.exceptions import RequestError

from backend.agent.sessions.session import Listener, Session
from backend.visible import visible

_FIELD = "answer"


class NoAnswerError(Exception):
    """Nobody chose an option; the text says to the model what to do instead."""


async def choose(
    session: Session, first: Listener | None, question: str, options: list[str], timeout_s: float
) -> tuple[str, str]:
    """Ask one person; return the chosen option and the person's name.

    The person is `first`, who asked for the turn, or else one who may approve. Raises `NoAnswerError`. Cancelling this
    withdraws the question.
    """
    able = [listener for listener in session.watching if listener.can_show_forms and _may_choose(listener, first)]
    if not able:
        raise NoAnswerError("Nobody can be asked this way. Put the question into your answer.")
    person = first if first in able else able[0]
    shown = [visible(option) for option in options]
    form = {"type": "object", "properties": {_FIELD: {"type": "string", "enum": shown}}, "required": [_FIELD]}
    params = {"sessionId": session.id, "mode": "form", "message": visible(question), "requestedSchema": form}
    await session.flushed()
    try:
        async with asyncio.timeout(timeout_s):
            result = await person.request("elicitation/create", params)
    except (TimeoutError, RequestError, ConnectionError):
        raise NoAnswerError("Nobody answered. Do not guess.") from None
    # The person's rights can have changed since the question was asked.
    if person in session.watching and _may_choose(person, first):
        for option, text in zip(options, shown, strict=True):
            if _chosen(result) == text:
                return option, person.name
    raise NoAnswerError("The person chose none of these. Do not guess.")


def _may_choose(listener: Listener, first: Listener | None) -> bool:
    return listener is first or listener.may_approve


def _chosen(result: Any) -> Any:
    if not isinstance(result, dict) or result.get("action") != "accept":
        return None
    content = result.get("content")
    return content.get(_FIELD) if isinstance(content, dict) else None
