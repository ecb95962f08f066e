"""A session in memory: who is attached, what comes next, the turns that wait, the answers that are remembered.

Every event of the session passes `record`, which numbers it; everyone attached gets the same events in the same
order. A turn belongs to the session and outlives the connection that asked for it.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from dataclasses import replace
from typing import Any, Protocol

import orjson

from backend.agent.control.permissions import Approver, Audience, PermissionDesk
from backend.agent.robot.client_servers import ClientServers
from backend.agent.sessions.history import History
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.store import Event, SessionRow, as_json

UNWINDING_S = 2.0
"""A turn that was cancelled so long ago and does not halt yet has lost the cancel, and gets another one."""

MAX_WAITING = 16
"""Prompts of one session that may wait while a turn runs."""

Spawn = Callable[[Coroutine[Any, Any, None]], "asyncio.Task[None]"]
Update = dict[str, Any]


class Listener(Approver, Protocol):
    """A connection that watches sessions."""

    @property
    def can_write_files(self) -> bool:
        """Whether the client writes files for the agent."""

    @property
    def can_show_forms(self) -> bool:
        """Whether the client can show a form to the person."""

    def deliver(self, frame: bytes) -> None:
        """Send a frame soon; never waits, never raises."""

    def cut_off_if_slow(self, held_bytes: int) -> None:
        """Cut the connection off if too much waits for it, with the `held_bytes` of events held back by a replay."""

    async def wait_for_space(self) -> None:
        """Return when the connection can take more of a long replay."""


class QueueFull(Exception):
    """Too many prompts wait in the session; the text tells what to do."""


class _Held:
    """The events that happen during a replay and follow it."""

    def __init__(self) -> None:
        self.frames: list[bytes] = []
        self.bytes = 0

    def add(self, frame: bytes) -> None:
        self.frames.append(frame)
        self.bytes += len(frame)


class Session:
    """One session. `row` is what is kept of it; `seq` the number of the last event recorded."""

    def __init__(
        self,
        row: SessionRow,
        journal: Journal,
        history: History,
        seq: int,
        permission_timeout_s: float,
        spawn: Spawn,
        audience: Audience | None = None,
    ) -> None:
        self.row = row
        self.history = history
        self.seq = seq
        self.desk = PermissionDesk(permission_timeout_s, spawn, audience)
        self.offered = ClientServers()
        self.turn_id: str | None = None
        """The running turn; None between turns."""
        self.turn_by: str | None = None
        """Who asked for the running turn; None between turns."""
        self._journal = journal
        self.shown = seq
        """The number of the last event that people may see: those after it are still being kept."""
        self._listeners: set[Listener] = set()
        self._catching_up: dict[Listener, _Held] = {}
        self.touched = time.monotonic()
        """When somebody last opened it."""
        self.ended = False
        """Set when the session is being deleted; nothing begins in it any more."""
        self._one_turn = asyncio.Lock()
        self._turns: set[asyncio.Task[str]] = set()
        self._halting: asyncio.Task[Any] | None = None
        self._cancelled_at = 0.0
        """When a turn was cancelled last."""

    @property
    def id(self) -> str:
        """The session id of ACP."""
        return self.row.id

    @property
    def remembered(self) -> dict[str, bool]:
        """Tool name -> allowed, for answers that count for the rest of the session."""
        return self.history.remembered

    @property
    def busy(self) -> bool:
        """Whether a turn runs or waits."""
        return bool(self._turns)

    @property
    def watching(self) -> frozenset[Listener]:
        """The connections that are attached."""
        return frozenset(self._listeners)

    def record(self, update: Update, origin: Listener | None = None) -> None:
        """Number an update, remember it, keep it, and then show it to everyone attached but `origin`."""
        raw = as_json(update)
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
        self.shown = event.seq
        for listener in self._listeners:
            if held := self._catching_up.get(listener):
                held.add(event.frame)
                listener.cut_off_if_slow(held.bytes)
            elif listener is not event.origin:
                listener.deliver(event.frame)

    async def attach(self, listener: Listener, replay: Callable[[int], AsyncIterator[Event]] | None = None) -> None:
        """Let a connection watch from now on, waiting for nothing. With `replay`, first send it the events up to this
        moment that `replay(upto)` yields; what happens meanwhile follows without a gap, a double or a change of order.
        """
        self._drop(listener)
        self.desk.detach(listener, returns=listener.may_approve)
        self._listeners.add(listener)
        if replay is not None:
            held = self._catching_up[listener] = _Held()
            try:
                async for event in replay(self.shown):
                    if self._catching_up.get(listener) is not held:
                        return  # detached meanwhile, and perhaps attached anew
                    listener.deliver(event.frame)
                    await listener.wait_for_space()
            except BaseException:
                if self._catching_up.get(listener) is held:
                    self.detach(listener)  # what follows half a replay would follow a gap
                raise
            if self._catching_up.get(listener) is not held:
                return
            del self._catching_up[listener]
            for frame in held.frames:
                listener.deliver(frame)
        self.judge(listener)

    def judge(self, listener: Listener) -> None:
        """Let a connection be asked, or no longer, after what it may do has changed."""
        self.desk.detach(listener, returns=listener.may_approve)
        if listener.may_approve:
            self.desk.attach(listener)

    def detach(self, listener: Listener) -> None:
        """Stop showing events to a connection; its open questions are withdrawn."""
        self._drop(listener)
        self.desk.detach(listener)

    def _drop(self, listener: Listener) -> None:
        self._listeners.discard(listener)
        self._catching_up.pop(listener, None)

    async def run_turn(self, turn: Callable[[], Coroutine[Any, Any, str]]) -> str:
        """Run a turn when those before it are over, and return its stop reason. Raises `QueueFull`.

        The turn is a task of its own: when the caller goes away, it runs on.
        """
        if self.ended:
            return "cancelled"
        if len(self._turns) > MAX_WAITING:
            raise QueueFull(f"{MAX_WAITING} prompts wait in this session already. Wait for one to end, or cancel.")
        task = asyncio.create_task(self._in_order(turn), name=f"turn of {self.id}")
        self._turns.add(task)
        task.add_done_callback(self._turns.discard)
        try:
            return await asyncio.shield(task)
        except asyncio.CancelledError:
            if task.cancelled():
                return "cancelled"  # before its first step
            raise

    async def _in_order(self, turn: Callable[[], Coroutine[Any, Any, str]]) -> str:
        try:
            async with self._one_turn:
                return await turn()
        except asyncio.CancelledError:
            return "cancelled"  # it still waited for its turn

    def halting(self) -> None:
        """The turn that calls this ends, and waits for the robot to rest: no cancel interrupts it any more."""
        self._halting = asyncio.current_task()

    def cancel(self) -> None:
        """End the running turn, and those that wait."""
        now = time.monotonic()
        lost = now - self._cancelled_at > UNWINDING_S
        for task in self._turns:
            if task is self._halting:
                continue
            # What ends may have to tell the robot's server first, which a second cancel would interrupt.
            if lost or not task.cancelling():
                task.cancel()
                self._cancelled_at = now

    async def close(self) -> None:
        """Cancel, wait until nothing of this session runs, and disconnect the servers that were brought into it.
        Being cancelled meanwhile reaches no turn."""
        while self._turns:
            self.cancel()
            await asyncio.wait(self._turns, timeout=UNWINDING_S)
        await self.offered.close()
