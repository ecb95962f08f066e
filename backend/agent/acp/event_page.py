"""A session's log for those who look things up in it, page by page: the answer to `_robot/events`.

It only reads: nobody is attached by it, and no question is put anew, as `session/load` would do.
"""

from __future__ import annotations

from typing import Any

from acp.exceptions import RequestError

from backend import wire
from backend.agent.sessions.session import Session
from backend.agent.sessions.sessions import Sessions

MOST = 500
"""Events of one page."""
ENOUGH_BYTES = 1024 * 1024
"""A page ends with the event that reaches this: one alone can be a picture of many megabytes."""


async def event_page(sessions: Sessions, session: Session, params: dict[str, Any]) -> dict[str, Any]:
    """The events after number `after`, at most `limit`, and the number of the session's last one, in `last`."""
    after, limit = _number(params, "after", 0), min(_number(params, "limit", MOST), MOST)
    await session.flushed()  # else what the same client did just now could be missing
    last = session.last_shown
    after = min(after, last)
    events: list[dict[str, Any]] = []
    size = 0
    async for event in sessions.replay(session, after, min(after + limit, last)):
        events.append({"seq": event.seq, "at": event.time, "update": event.update})
        size += len(event.raw)
        if size >= ENOUGH_BYTES:
            break
    return {"events": events, "last": last}


def _number(params: dict[str, Any], name: str, otherwise: int) -> int:
    value = params.get(name, otherwise)
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise RequestError(wire.INVALID_PARAMS, f"{name} must be a number from 0 on.")
    return value
