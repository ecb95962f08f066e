"""A session's log as JSON Lines: one event a line, as it was sent, with its number and its time."""

from __future__ import annotations

import posixpath
from collections.abc import Iterable

import orjson
from acp.exceptions import RequestError

from backend.agent.session import Listener, Session
from backend.agent.store import Event, Store


def as_lines(events: Iterable[Event]) -> str:
    """The events as JSON Lines; times are Unix seconds."""
    return "".join(
        orjson.dumps({"seq": e.seq, "time": e.time, "update": e.update}, option=orjson.OPT_APPEND_NEWLINE).decode()
        for e in events
    )


async def hand_over(session: Session, store: Store, to: Listener | None) -> str:
    """Write the log through the client that asked, where it takes files, and tell in words what came of it."""
    if to is None or not to.takes_files:
        return (
            "Your program takes no files from me. On the robot's computer, "
            f"`robot-acp sessions export {session.id}` prints the log."
        )
    await session.flushed()
    path = posixpath.join(session.row.cwd, f"robot-acp-{session.id}.jsonl")
    content = as_lines([event async for event in store.events(session.id)])
    try:
        await to.request("fs/write_text_file", {"sessionId": session.id, "path": path, "content": content})
    except (RequestError, ConnectionError):
        return f"Your program did not write {path}."
    return f"The log of this session is in {path}."
