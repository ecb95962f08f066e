"""A session's log as JSON Lines: one event a line, as it was sent, with its number and its time."""

from __future__ import annotations

import asyncio
import posixpath
import sys
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from datetime import datetime

import orjson
from acp.exceptions import RequestError

from backend import wire
from backend.agent.sessions.database import StoreError
from backend.agent.sessions.session import Listener, Session
from backend.agent.sessions.store import Event, Store
from backend.config import ConfigError
from backend.visible import visible

_ENVELOPE_BYTES = 64 * 1024
"""Reserved for all of a message but its content: mostly the path."""


_GONE = "Whoever asked for the log is no longer here."


def as_lines(events: Iterable[Event]) -> str:
    """The events as JSON Lines; times are Unix seconds."""
    return "".join(
        orjson.dumps({"seq": e.seq, "time": e.time, "update": e.update}, option=orjson.OPT_APPEND_NEWLINE).decode()
        for e in events
    )


async def hand_over(session: Session, store: Store, to: Listener | None, timeout_s: float) -> str:
    """Have the client `to` write the log to a file, and say in words whether it did.

    The client needs the capability to write files, and has `timeout_s` seconds to answer.
    """
    otherwise = f"On the robot's computer, `robot-acp sessions export {session.id}` prints the log."
    if to is None or not to.can_write_files:
        return f"Your program takes no files from me. {otherwise}"
    if to not in session.watching:
        return _GONE
    folder = to.folder_of(session.id)  # never the owner's: it is a path on another computer
    if folder is None:
        return f"Your program named no folder when it opened this session. Open the session again. {otherwise}"
    path = posixpath.join(folder, f"robot-acp-{session.id}.jsonl")
    await session.flushed()
    lines: list[str] = []
    size = 0
    async for event in store.events(session.id):
        lines.append(as_lines([event]))
        size += len(orjson.dumps(lines[-1]))  # as it is on the wire
        if size > wire.MAX_FRAME_BYTES - _ENVELOPE_BYTES:
            return f"The log is too long for one message to your program. {otherwise}"
    if to not in session.watching:
        return _GONE
    try:
        async with asyncio.timeout(timeout_s):
            await to.request("fs/write_text_file", {"sessionId": session.id, "path": path, "content": "".join(lines)})
    except (TimeoutError, RequestError, ConnectionError):
        return f"Your program did not write {path}."
    return f"The log of this session is in {path}."


async def list_sessions(database_url: str) -> int:
    """Print the sessions, newest first: id, time of the last event, owner, title."""
    async with _opened(database_url) as store:
        before: tuple[float, str] | None = None
        while rows := await store.sessions(None, before, 100):
            for row in rows:
                updated = datetime.fromtimestamp(row.updated).isoformat(" ", "minutes")
                print(row.id, updated, visible(row.owner), visible(row.title or ""), sep="  ")
            before = (rows[-1].updated, rows[-1].id)
    return 0


async def print_session(database_url: str, session_id: str) -> int:
    """Print the events of a session as JSON Lines; the exit status is 1 when there is none of this id."""
    async with _opened(database_url) as store:
        if await store.session(session_id) is None:
            print(f"robot-acp: There is no session {session_id}. See `robot-acp sessions list`.", file=sys.stderr)
            return 1
        async for event in store.events(session_id):
            sys.stdout.write(as_lines([event]))
    return 0


@asynccontextmanager
async def _opened(database_url: str) -> AsyncIterator[Store]:
    store = Store(database_url, writes=False)
    try:
        await store.open()
    except StoreError as error:
        raise ConfigError(str(error)) from None
    try:
        yield store
    finally:
        await store.close()
