"""A session in memory: its events, who is attached to it, and its turns.

Every event of the session passes through `record`, which numbers it, so everyone attached gets the same events in the
same order. The session starts, queues, cancels and ends its turns; a `Turn` does the work of one prompt. A turn belongs
to the session and outlives the connection that asked for it.

A cancel takes one path. Whoever cancels, be it a client, a supervisor who takes the robot over, or the end of the
process, calls `Session.cancel`, which cancels the turn's task. The work then ends wherever it waits: a permission
request is withdrawn, a tool call is cancelled. After that the turn halts: it waits until the robot is at rest. The
prompt is answered with "cancelled" only then.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine
from dataclasses import replace
from typing import Any, Protocol

import orjson

from backend import wire
from backend.agent.acp import updates
from backend.agent.control.approvers import AbsentApprovers, Approver, PermissionRequests
from backend.agent.robot.client_servers import ClientServers
from backend.agent.sessions.history import History
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.store import Event, SessionRow, as_json

RECANCEL_AFTER_S = 2.0
"""A turn that was cancelled so long ago and still works has lost the cancel; the next cancel reaches it again."""

MAX_EVENT_BYTES = wire.MAX_FRAME_BYTES - 1024 * 1024
"""What is in a larger update is left out, because no client could ever be sent it."""

MAX_WAITING = 16
"""Prompts of one session that may wait while a turn runs."""

Spawn = Callable[[Coroutine[Any, Any, None]], "asyncio.Task[None]"]
Update = dict[str, Any]
Pose = dict[str, Any]


class Listener(Approver, Protocol):
    """A connection that watches sessions."""

    @property
    def can_write_files(self) -> bool:
        """Whether the client writes files for the agent."""

    @property
    def can_show_forms(self) -> bool:
        """Whether the client can show a form to the person."""

    def folder_of(self, session_id: str) -> str | None:
        """The folder that the client named when it opened the session; None where it has not."""

    def deliver(self, frame: bytes) -> None:
        """Send a frame soon; never waits, never raises."""

    def cut_off_if_slow(self, held_bytes: int) -> None:
        """Cut the connection off if too much waits for it, with the `held_bytes` of events held back by a replay."""

    async def wait_for_space(self) -> None:
        """Return when the connection can take more of a long replay."""


class Turn(Protocol):
    """The work of one prompt. A session calls `work`, then `halt` where the work was cancelled or failed, then
    `close`."""

    @property
    def id(self) -> str:
        """The id of the turn."""

    async def work(self) -> str:
        """Do what the prompt asks for, and return ACP's stop reason."""

    async def halt(self, error: BaseException) -> str:
        """End every open tool call, wait until the robot is at rest, and return ACP's stop reason. `error` is what
        ended the work. No cancel interrupts this."""

    def close(self) -> None:
        """Free the robot for other turns. Nothing is done for the turn after this."""

    def seconds(self) -> dict[str, float]:
        """How long the turn has taken, in seconds by phase."""


class QueueFull(Exception):
    """Too many prompts wait in the session; the text says what to do."""


class _Held:
    """The events that are recorded during a replay. They are delivered after it."""

    def __init__(self) -> None:
        self.frames: list[bytes] = []
        self.bytes = 0

    def add(self, frame: bytes) -> None:
        self.frames.append(frame)
        self.bytes += len(frame)


class Session:
    """One session. `row` is what the database keeps of it beside its events; `seq` is the number of the last event
    recorded."""

    def __init__(
        self,
        row: SessionRow,
        journal: Journal,
        history: History,
        seq: int,
        permission_timeout_s: float,
        spawn: Spawn,
        absent: AbsentApprovers | None = None,
        robot_pose: Callable[[], Awaitable[Pose | None]] | None = None,
        recancel_after_s: float = RECANCEL_AFTER_S,
    ) -> None:
        self.row = row
        self.seq = seq
        self.history = history
        self.permission_requests = PermissionRequests(permission_timeout_s, spawn, absent)
        self.client_servers = ClientServers()
        self.last_shown = seq
        """The number of the last event that people may see. The events after it wait to be kept."""
        self.last_opened = time.monotonic()
        """When somebody last opened the session, in seconds of the monotonic clock."""
        self.deleted = False
        """Set when the deletion of the session begins; no turn starts in it any more."""
        self._journal = journal
        self._robot_pose = robot_pose
        self._listeners: set[Listener] = set()
        self._catching_up: dict[Listener, _Held] = {}
        self._recancel_after_s = recancel_after_s
        self._one_turn = asyncio.Lock()
        self._tasks: set[asyncio.Task[str]] = set()
        """One task for each turn that runs or waits."""
        self._turn: Turn | None = None
        """The turn that runs; None between turns."""
        self._halting: asyncio.Task[Any] | None = None
        """The task of the running turn while it halts; None otherwise."""
        self._cancelled_at = 0.0
        """When a turn was last cancelled, in seconds of the monotonic clock."""

    @property
    def id(self) -> str:
        """The session id of ACP."""
        return self.row.id

    @property
    def remembered(self) -> dict[str, bool]:
        """Tool name -> allowed, for answers that count for the rest of the session."""
        return self.history.remembered

    @property
    def turn_id(self) -> str | None:
        """The id of the turn that runs; None between turns."""
        return self._turn.id if self._turn else None

    @property
    def busy(self) -> bool:
        """Whether a turn runs or waits."""
        return bool(self._tasks)

    @property
    def unfinished_turns(self) -> int:
        """How many turns run, wait, or halt."""
        return len(self._tasks)

    @property
    def watching(self) -> frozenset[Listener]:
        """The connections that are attached."""
        return frozenset(self._listeners)

    # Events

    def record(self, update: Update, origin: Listener | None = None) -> None:
        """Number an update, add it to the history, keep it, and then show it to everyone attached but `origin`."""
        raw = as_json(update)
        if len(raw) > MAX_EVENT_BYTES:
            raw = as_json(updates.too_large(update, len(raw)))
        self.seq += 1
        self.history.apply(orjson.loads(raw))
        self._journal.append(Event(self.id, self.seq, time.time(), raw, origin), self._show)

    async def flushed(self) -> None:
        """Return when all that was recorded so far has been kept and shown."""
        await self._journal.flush()

    def change(self, **fields: object) -> None:
        """Change columns of `row`, here at once and in the database soon."""
        self.row = replace(self.row, **fields)  # type: ignore[arg-type] # the fields of SessionRow
        self._journal.change(self.id, fields)

    def _show(self, event: Event) -> None:
        self.last_shown = event.seq
        for listener in self._listeners:
            if held := self._catching_up.get(listener):
                held.add(event.frame)
                listener.cut_off_if_slow(held.bytes)
            elif listener is not event.origin:
                listener.deliver(event.frame)

    # Who is attached

    async def attach(self, listener: Listener, replay: Callable[[int], AsyncIterator[Event]] | None = None) -> None:
        """Show every event from now on to a connection, and send it permission requests if it may approve.

        With `replay`, the connection first gets the events that `replay(upto)` yields, where `upto` is the number of
        the last event that has been shown. Events that are recorded meanwhile follow without a gap, a duplicate or a
        change of order. Without `replay`, this waits for nothing.
        """
        self._drop(listener)
        self.permission_requests.detach(listener, reattaching=listener.may_approve)
        self._listeners.add(listener)
        if replay is not None:
            held = self._catching_up[listener] = _Held()
            try:
                async for event in replay(self.last_shown):
                    if self._catching_up.get(listener) is not held:
                        return  # detached meanwhile, and perhaps attached anew
                    listener.deliver(event.frame)
                    await listener.wait_for_space()
            except BaseException:
                if self._catching_up.get(listener) is held:
                    self.detach(listener)  # after half a replay, the next events would follow a gap
                raise
            if self._catching_up.get(listener) is not held:
                return
            del self._catching_up[listener]
            for frame in held.frames:
                listener.deliver(frame)
        self.rights_changed(listener)

    def rights_changed(self, listener: Listener) -> None:
        """Send permission requests to an attached connection, or stop sending them, as its rights are now."""
        self.permission_requests.detach(listener, reattaching=listener.may_approve)
        if listener.may_approve:
            self.permission_requests.attach(listener)

    def detach(self, listener: Listener) -> None:
        """Stop showing events to a connection, and withdraw the pending permission requests from it."""
        self._drop(listener)
        self.permission_requests.detach(listener)

    def _drop(self, listener: Listener) -> None:
        self._listeners.discard(listener)
        self._catching_up.pop(listener, None)

    # Turns

    async def run_turn(self, turn: Turn) -> str:
        """Run a turn when those before it are over, and return its stop reason. Raises `QueueFull`.

        The turn is a task of its own: when the caller is cancelled, it runs on.
        """
        if self.deleted:
            return "cancelled"
        if len(self._tasks) > MAX_WAITING:
            raise QueueFull(f"{MAX_WAITING} prompts wait in this session already. Wait for one to end, or cancel.")
        task = asyncio.create_task(self._run_in_order(turn), name=f"turn of {self.id}")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        try:
            return await asyncio.shield(task)
        except asyncio.CancelledError:
            if task.cancelled():
                return "cancelled"  # before its first step
            raise

    def cancel(self) -> None:
        """Cancel the turn that runs, and those that wait. A turn that halts already is left alone."""
        now = time.monotonic()
        again = now - self._cancelled_at > self._recancel_after_s
        for task in self._tasks:
            if task is self._halting:
                continue
            # A second cancel at once would interrupt a tool call that tells its server of the first one.
            if again or not task.cancelling():
                task.cancel()
                self._cancelled_at = now

    async def close(self) -> None:
        """Cancel every turn, wait until none runs, and disconnect the MCP servers that a client brought.

        Cancelling this does not stop a turn from halting.
        """
        while self._tasks:
            self.cancel()
            await asyncio.wait(self._tasks, timeout=self._recancel_after_s)
        await self.client_servers.close()

    async def _run_in_order(self, turn: Turn) -> str:
        try:
            async with self._one_turn:
                await self._complete_start_pose()
                return await self._run(turn)
        except asyncio.CancelledError:
            return "cancelled"  # before the work began

    async def _complete_start_pose(self) -> None:
        """Keep the robot's pose as the start of a session that began while the robot was not there."""
        if self.row.start_pose is None and self._robot_pose and (pose := await self._robot_pose()):
            self.change(start_pose=pose)

    async def _run(self, turn: Turn) -> str:
        self._turn = turn
        reason = "cancelled"
        try:
            try:
                reason = await turn.work()
            except (Exception, asyncio.CancelledError) as error:
                self._halting = asyncio.current_task()
                reason = await turn.halt(error)
        finally:
            # Whatever happened: the robot is free for other turns, and everybody sees that this one is over.
            turn.close()
            self._turn = self._halting = None
            self.record(updates.turn_ended(turn.id, reason, turn.seconds()))
        return reason
