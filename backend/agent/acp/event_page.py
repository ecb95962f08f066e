"""A page of a session's log: the answer to `_robot/events`.

It only reads. Unlike `session/load` it attaches nobody, and puts no open question to anybody.
"""

from __future__ import annotations

from typing import Any

from acp.exceptions import RequestError

from backend import wire
from backend.agent.sessions.session import Session
from backend.agent.sessions.sessions import Sessions

MAX_EVENTS = 500
"""Events of one page, at most."""
FULL_BYTES = 1024 * 1024
"""A page ends with the event that reaches this size: a single event can be a picture of many megabytes."""


async def event_page(sessions: Sessions, session: Session, params: dict[str, Any]) -> dict[str, Any]:
    """The events after number `after`, at most `limit` of them, and in `last` the number of the session's last event.

    Raises `RequestError` for an `after` or a `limit` that is no number from 0 on.
    """
    after, limit = _number(params, "after", 0), min(_number(params, "limit", MAX_EVENTS), MAX_EVENTS)
    await session.flushed()  # an event that this client caused just now has to be in the page
    last = session.last_shown
    after = min(after, last)
    events: list[dict[str, Any]] = []
    size = 0
    async for event in sessions.replay(session, after, min(after + limit, last)):
        events.append({"seq": event.seq, "at": event.time, "update": event.update})
        size += len(event.raw)
        if size >= FULL_BYTES:
            break
    return {"events": events, "last": last}


def _number(params: dict[str, Any], name: str, default: int) -> int:
    value = params.get(name, default)
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise RequestError(wire.INVALID_PARAMS, f"{name} must be a number from 0 on.")
    return value
