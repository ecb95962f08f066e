"""A question to a person with a few answers to choose from, as ACP's form elicitation.

For what is ambiguous, never for permission: an answer here allows nothing.
"""

from __future__ import annotations

import asyncio
from typing import Any

from acp.exceptions import RequestError

from backend.agent.session import Listener, Session

_FIELD = "answer"


class NoAnswerError(Exception):
    """Nobody chose; the text tells the model what to do instead."""


async def choose(session: Session, first: Listener | None, question: str, options: list[str], timeout_s: float) -> str:
    """The option that a person chose: whoever asked for the turn, else anyone attached who can be shown a form.

    Raises `NoAnswerError`. Cancelling it withdraws the question.
    """
    able = [listener for listener in session.watching if listener.takes_forms]
    if not able:
        raise NoAnswerError("Nobody can be asked this way. Put the question into your answer.")
    person = first if first in able else able[0]
    form = {"type": "object", "properties": {_FIELD: {"type": "string", "enum": options}}, "required": [_FIELD]}
    params = {"sessionId": session.id, "mode": "form", "message": question, "requestedSchema": form}
    await session.flushed()
    try:
        async with asyncio.timeout(timeout_s):
            result = await person.request("elicitation/create", params)
    except (TimeoutError, RequestError, ConnectionError):
        raise NoAnswerError("Nobody answered. Do not guess.") from None
    for option in options:
        if _chosen(result) == option:
            return option
    raise NoAnswerError("The person chose none of these. Do not guess.")


def _chosen(result: Any) -> Any:
    if not isinstance(result, dict) or result.get("action") != "accept":
        return None
    content = result.get("content")
    return content.get(_FIELD) if isinstance(content, dict) else None
