"""All sessions of the agent: creates them, loads them from the database, lists and deletes them.

Who may see which session is decided here, and nowhere else. Nobody else adds a session to memory.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
import uuid
from collections.abc import AsyncIterator, Coroutine
from dataclasses import replace
from typing import Any

from sqlalchemy.exc import SQLAlchemyError

from backend import meta as keys
from backend.agent.acp import updates
from backend.agent.control.approvers import GRACE_S, AbsentApprovers
from backend.agent.robot.mcp_client import McpClient
from backend.agent.robot.readings import read
from backend.agent.sessions import upkeep
from backend.agent.sessions.database import StoreError
from backend.agent.sessions.history import History
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.session import Listener, Session
from backend.agent.sessions.store import Event, SessionRow, Store, as_json
from backend.agent.sessions.usage import Usage
from backend.identity import Identity, Right

log = logging.getLogger(__name__)

PAGE = 50
"""Sessions of one page of the list."""
PAGE_BYTES = 256 * 1024
IDLE_S = 600.0
"""A session that nobody uses is removed from memory after so many seconds."""


class Sessions:
    """The sessions of one agent, by id. A session is loaded into memory when somebody opens it."""

    def __init__(
        self,
        store: Store,
        journal: Journal,
        tools: McpClient,
        pose_tool: str,
        permission_timeout_s: float,
        grace_s: float = GRACE_S,
        idle_s: float = IDLE_S,
        usage: Usage | None = None,
    ) -> None:
        """`pose_tool` is the robot's tool that returns its pose, `permission_timeout_s` the time for an answer to a
        permission request, `grace_s` how long a person who disconnected is expected back, `idle_s` how long a session
        that nobody uses stays in memory; all in seconds. `usage` counts what is kept."""
        self._store = store
        self._journal = journal
        self._tools = tools
        self._pose_tool = pose_tool
        self._permission_timeout_s = permission_timeout_s
        self.idle_s = idle_s
        self._usage = usage or Usage()
        self._open: dict[str, Session] = {}
        self._hidden: set[str] = set()
        """The ids of sessions that are being made from others, or deleted: nobody sees half of one."""
        self._deleting: dict[str, asyncio.Task[None]] = {}
        self._giving_back: asyncio.Task[None] | None = None
        self._opening = asyncio.Lock()
        self._tasks: set[asyncio.Task[None]] = set()
        self._absent = AbsentApprovers(self._everybody, grace_s)

    @property
    def open_sessions(self) -> list[Session]:
        """The sessions in memory."""
        return list(self._open.values())

    async def create(self, owner: str, cwd: str, mode: str, model: str) -> Session:
        """A new session, which keeps the robot's pose at this moment as its start."""
        now = time.time()
        pose = await self.robot_pose()
        row = SessionRow(uuid.uuid4().hex, owner, None, cwd.replace("\0", ""), mode, model, pose, now, now)
        self._usage.add_session(row)  # also where this is cancelled: an empty session is purged later
        await self._store.add_session(row)
        session = self._in_memory(row, History(), 0)
        self._open[session.id] = session
        return session

    async def fork(self, session: Session, owner: str, cwd: str = "/") -> Session:
        """A session of `owner` with the same events, up to the end of the last turn that has ended."""
        await session.flushed()
        ended = 0
        async for event in self._store.events(session.id):
            turn = (event.update.get("_meta") or {}).get(keys.TURN) or {}
            ended = event.seq if turn.get("state") == "ended" else ended
        now = time.time()
        row = replace(
            session.row, id=uuid.uuid4().hex, owner=owner, cwd=cwd.replace("\0", ""), created=now, updated=now
        )
        self._hidden.add(row.id)
        try:
            self._usage.add_session(row)
            await self._store.add_session(row)
            if ended:
                # First, because without it the fork would have the answers "always" of the original.
                forked = Event(row.id, ended + 1, now, as_json(updates.forked(session.id)))
                await self._store.append([forked])
                self._usage.add_event(forked)
                await self._store.copy_events(session.id, row.id, ended)
                self._usage.add_copy(session.id, row.id)
        except BaseException:
            self._hidden.discard(row.id)
            self._spawn(self._remove_half(row.id))
            raise
        self._hidden.discard(row.id)
        async with self._opening:
            fork = self._open.get(row.id) or await self._load(row.id)
        if fork is None:
            raise StoreError("The fork was deleted meanwhile.")
        return fork

    async def get(self, session_id: str, identity: Identity) -> Session | None:
        """The session, if there is one that this person may see."""
        session = self._open.get(session_id)
        if session is None:  # a session in memory does not wait for the database: somebody may have to cancel it
            async with self._opening:
                session = self._open.get(session_id)
                if session is None and session_id not in self._hidden:
                    session = await self._load(session_id)
        if session is None or session.id in self._hidden or not self.shows(session, identity):
            return None
        session.last_opened = time.monotonic()
        return session

    def cancel_all(self) -> int:
        """Cancel every turn of every session, those that wait, too. Returns how many."""
        for session in self.open_sessions:
            session.cancel()
        return sum(session.unfinished_turns for session in self.open_sessions)

    def _forget_idle(self) -> None:
        """Remove sessions that nobody uses from memory; the database has them."""
        long_ago = time.monotonic() - self.idle_s
        for session in self.open_sessions:
            if session.last_opened < long_ago and not self._works(session):
                del self._open[session.id]
                self._spawn(session.client_servers.close())

    def turn_of(self, session_id: str) -> str | None:
        """The id of the turn that runs in a session; None between turns."""
        session = self._open.get(session_id)
        return session.turn_id if session else None

    async def page(
        self, identity: Identity, before: tuple[float, str] | None, search: str = ""
    ) -> tuple[list[SessionRow], SessionRow | None]:
        """At most `PAGE` sessions that this person may see, newest first, and the one behind which the next page
        begins; None at the end. A page ends with the session with which its texts reach `PAGE_BYTES`.

        `before` is the (updated, id) of the last session of the page before. Each word of `search` is in the session's
        title or in its owner's name.
        """
        owner = identity.name if identity.role == "visitor" else None
        rows = await self._store.sessions(owner, before, PAGE, search)
        page: list[SessionRow] = []
        size = 0
        for row in rows:
            page.append(row)
            size += len(as_json((row.cwd, row.title, row.owner)))
            if size >= PAGE_BYTES:
                break
        more = len(page) < len(rows) or len(rows) == PAGE
        return [row for row in page if not self._is_hidden(row.id)], page[-1] if more else None

    async def delete(self, session: Session) -> None:
        """End and remove a session. It is removed also where the caller is cancelled.

        Where the database cannot be written, this raises and the session is as before, but for its turns, which ended.
        """
        if session.id not in self._deleting:
            if self._journal.failure:
                raise StoreError(self._journal.failure)
            session.deleted = True
            task = self._deleting[session.id] = asyncio.create_task(self._delete(session), name="delete a session")
            task.add_done_callback(lambda _: self._deleting.pop(session.id, None))
            task.add_done_callback(lambda done: done.cancelled() or done.exception())  # nobody may wait for it
        await asyncio.shield(self._deleting[session.id])

    async def _delete(self, session: Session) -> None:
        try:
            await session.close()
            await session.flushed()
            await self._remove(session.id)
        except BaseException:
            session.deleted = False
            raise
        self._open.pop(session.id, None)

    def in_use(self, session_id: str) -> bool:
        """Whether somebody watches a session, a turn runs in it, or it is being made or deleted. Who is just opening it
        is told that it is gone."""
        session = self._open.get(session_id)
        if session is None:
            return session_id in self._hidden
        return session.deleted or self._works(session)

    async def remove_unused(self, session_id: str) -> bool:
        """Delete a session that nobody uses, and say whether it was deleted."""
        async with self._opening:
            if self.in_use(session_id):
                return False
            if session := self._open.pop(session_id, None):
                session.deleted = True
                self._spawn(session.client_servers.close())
            self._hidden.add(session_id)
        try:
            await self._remove(session_id)
        finally:
            self._hidden.discard(session_id)
        return True

    async def _remove(self, session_id: str) -> None:
        await self._store.delete_session(session_id)
        self._usage.remove(session_id)
        if self._giving_back is None or self._giving_back.done():
            self._giving_back = self._spawn(self._give_back_space())

    async def _give_back_space(self) -> None:
        with contextlib.suppress(SQLAlchemyError):  # the database is away: the next time will do
            await upkeep.give_back_space(self._store)

    async def _remove_half(self, session_id: str) -> None:
        with contextlib.suppress(SQLAlchemyError):
            await self.remove_unused(session_id)

    def _works(self, session: Session) -> bool:
        return session.busy or bool(session.watching) or bool(self._journal.unkept(session.id))

    def _is_hidden(self, session_id: str) -> bool:
        session = self._open.get(session_id)
        return session_id in self._hidden or (session is not None and session.deleted)

    async def replay(self, session: Session, after: int, upto: int) -> AsyncIterator[Event]:
        """The events of a session that have been shown, with `after < seq <= upto`."""
        # Asked for before the database is read: an event that is kept in between is in both, and none is in neither.
        unkept = self._journal.unkept(session.id, after, upto)
        async for event in self._store.events(session.id, after, upto):
            after = event.seq
            yield event
        for event in unkept:
            if event.seq > after:
                yield event

    async def robot_pose(self) -> dict[str, Any] | None:
        """The result of the pose tool; None when the robot is not there or has no such tool."""
        return await read(self._tools, self._pose_tool)

    async def close(self) -> None:
        """Cancel every turn and wait until the robot is at rest."""
        await asyncio.gather(*(session.close() for session in self.open_sessions))
        await asyncio.gather(*self._deleting.values(), return_exceptions=True)
        for task in list(self._tasks):
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    async def _load(self, session_id: str) -> Session | None:
        row = await self._store.session(session_id)
        if row is None:
            return None
        history = History()
        seq = 0
        async for event in self._store.events(session_id):
            history.apply(event.update)
            seq = event.seq
        session = self._in_memory(row, history, seq)
        self._open[session_id] = session
        if history.interrupted is not None:
            self._record_interruption(session, history.interrupted)
            await session.flushed()
        return session

    def _record_interruption(self, session: Session, turn_id: str) -> None:
        for call_id in session.history.open_calls:
            session.record(updates.tool_status(call_id, "failed", "interrupted"))
        session.record(updates.message("I was restarted in the middle of this; what was under way has ended."))
        session.record(updates.turn_ended(turn_id, "interrupted"))

    def _in_memory(self, row: SessionRow, history: History, seq: int) -> Session:
        self._forget_idle()
        timeout_s = self._permission_timeout_s
        return Session(
            row, self._journal, history, seq, timeout_s, self._spawn, self._absent, lambda: self.robot_pose()
        )

    def _everybody(self) -> list[Listener]:
        return [listener for session in self.open_sessions for listener in session.watching]

    def _spawn(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    @staticmethod
    def shows(session: Session, identity: Identity) -> bool:
        """Whether this person may see the session."""
        own = session.row.owner == identity.name
        return not session.deleted and (own or identity.role != "visitor" or identity.may(Right.TAKE_OVER))
