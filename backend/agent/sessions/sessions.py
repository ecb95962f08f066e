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

from backend import meta as keys
from backend.agent.acp import updates
from backend.agent.control.approvers import GRACE_S, AbsentApprovers
from backend.agent.robot.mcp_client import McpClient
from backend.agent.robot.readings import read
from backend.agent.sessions.history import History
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.session import Listener, Session
from backend.agent.sessions.store import Event, SessionRow, Store, as_json
from backend.identity import Identity, Right

log = logging.getLogger(__name__)

PAGE = 50
"""Sessions of one page of the list."""
IDLE_S = 600.0
"""A session that nobody uses is removed from memory after so many seconds."""

END_S = 2.5
"""How long the end of the process waits for turns that halt. `robot-acp up` kills a process after three seconds."""


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
    ) -> None:
        """`pose_tool` is the robot's tool that returns its pose, `permission_timeout_s` the time for an answer to a
        permission request, `grace_s` how long a person who disconnected is expected back, `idle_s` how long a session
        that nobody uses stays in memory; all in seconds."""
        self._store = store
        self._journal = journal
        self._tools = tools
        self._pose_tool = pose_tool
        self._permission_timeout_s = permission_timeout_s
        self.idle_s = idle_s
        self._open: dict[str, Session] = {}
        self._opening = asyncio.Lock()
        self._tasks: set[asyncio.Task[None]] = set()
        self._absent = AbsentApprovers(self._everybody, grace_s)
        self._end_at: float | None = None
        """When the process stops waiting for turns that halt, by the clock of the event loop; None before its end."""

    @property
    def open_sessions(self) -> list[Session]:
        """The sessions in memory."""
        return list(self._open.values())

    async def create(self, owner: str, cwd: str, mode: str, model: str) -> Session:
        """A new session, which keeps the robot's pose at this moment as its start."""
        now = time.time()
        pose = await self.robot_pose()
        row = SessionRow(uuid.uuid4().hex, owner, None, cwd.replace("\0", ""), mode, model, pose, now, now)
        await self._store.add_session(row)
        session = self._in_memory(row, History(), 0)
        self._open[session.id] = session
        return session

    async def fork(self, session: Session, owner: str) -> Session:
        """A session of `owner` with the same events, up to the end of the last turn that has ended."""
        await session.flushed()
        now = time.time()
        row = replace(session.row, id=uuid.uuid4().hex, owner=owner, created=now, updated=now)
        await self._store.add_session(row)
        past: list[Event] = []
        ended = 0
        async for event in self._store.events(session.id):
            past.append(replace(event, session_id=row.id))
            turn = (event.update.get("_meta") or {}).get(keys.TURN) or {}
            ended = event.seq if turn.get("state") == "ended" else ended
        past = [event for event in past if event.seq <= ended]
        if past:
            ended += 1
            past.append(Event(row.id, ended, now, as_json(updates.forked(session.id))))
            await self._store.append(past)
        history = History()
        for event in past:
            history.apply(event.update)
        fork = self._in_memory(row, history, ended)
        self._open[fork.id] = fork
        return fork

    async def get(self, session_id: str, identity: Identity) -> Session | None:
        """The session, if there is one that this person may see."""
        session = self._open.get(session_id)
        if session is None:  # a session in memory does not wait for the database: somebody may have to cancel it
            async with self._opening:
                session = self._open.get(session_id) or await self._load(session_id)
        if session is None or not self.shows(session, identity):
            return None
        session.last_opened = time.monotonic()
        return session

    def _forget_idle(self) -> None:
        """Remove sessions that nobody uses from memory; the database has them."""
        long_ago = time.monotonic() - self.idle_s
        for session in self.open_sessions:
            if session.busy or session.watching or self._journal.unkept(session.id):
                continue
            if session.last_opened < long_ago:
                del self._open[session.id]
                self._spawn(session.client_servers.close())

    def turn_of(self, session_id: str) -> str | None:
        """The id of the turn that runs in a session; None between turns."""
        session = self._open.get(session_id)
        return session.turn_id if session else None

    async def page(self, identity: Identity, before: tuple[float, str] | None, search: str = "") -> list[SessionRow]:
        """At most `PAGE` sessions that this person may see, newest first.

        `before` is the (updated, id) of the last session of the page before. Each word of `search` is in the session's
        title or in its owner's name.
        """
        owner = identity.name if identity.role == "visitor" else None
        return await self._store.sessions(owner, before, PAGE, search)

    async def delete(self, session: Session) -> None:
        """End and remove a session."""
        session.deleted = True
        await session.close()
        await session.flushed()
        async with self._opening:
            await self._store.delete_session(session.id)
            self._open.pop(session.id, None)

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
        """Cancel every turn and wait until the robot is at rest, `END_S` seconds at most from the first call on.

        A turn that still halts then ends with the process, as if the process had died: the robot server notices that
        its client is gone, and the next agent says that the turn was cut short.
        """
        loop = asyncio.get_running_loop()
        self._end_at = self._end_at or loop.time() + END_S
        closing = [asyncio.create_task(session.close()) for session in self.open_sessions]
        if closing:
            _, late = await asyncio.wait(closing, timeout=max(0.0, self._end_at - loop.time()))
            for task in late:
                task.cancel()
            if late:
                log.error("the agent ends, and the robot is not known to be at rest")
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
