"""Writes the events of all sessions to the database, and shows each event only after that: durable before visible.

So `kill -9` loses no event that any client has seen. `append` never waits, and the events that are appended during a
write share the next ones. Each write is a piece of bounded size. While the database cannot be written, events are shown
at once and written later, because people must go on seeing a robot that moves.
"""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections import deque
from collections.abc import Callable

from backend.agent.sessions.database import StoreError, why
from backend.agent.sessions.store import Changes, Event, Store

log = logging.getLogger(__name__)

RETRY_S = 1.0
"""After a write that failed, the next one begins at the latest after so many seconds."""
PROBE_S = 5.0
"""A database that nobody writes to is asked so often whether it is there, in seconds: pages that open must know."""
PATIENCE_S = 2.0
"""A write that takes longer counts as failed for those who watch, so that people go on seeing what happens. It is
awaited all the same: the same events are never sent a second time beside it."""
PIECE_EVENTS = 200
PIECE_BYTES = 1024 * 1024
"""A write has so many events at most, and ends with the event that reaches this size: each makes progress, however
much waits."""
MAX_BACKLOG_BYTES = 64 * 1024 * 1024
"""While more than this waits for the database, people change no settings: what waits is in memory."""

Publish = Callable[[Event], None]
Unwatch = Callable[[], None]


class Journal:
    """The only writer of events. Events are kept and shown only while `run` is running.

    `count` is called with each event that is appended.
    """

    def __init__(
        self,
        store: Store,
        *,
        retry_s: float = RETRY_S,
        patience_s: float = PATIENCE_S,
        probe_s: float = PROBE_S,
        count: Callable[[Event], None] = lambda _event: None,
    ) -> None:
        self.retry_s = retry_s
        self.patience_s = patience_s
        self.probe_s = probe_s
        self._store = store
        store.failed = lambda: self._wake.set()  # ask at once whether the database is there
        self._count = count
        self._unkept: deque[Event] = deque()
        self._unkept_bytes = 0
        """Of the events in `_unkept` and `_keeping`."""
        self._keeping: list[Event] = []
        """The events of the write that is under way."""
        self._keeping_changes: Changes = {}
        self._write: asyncio.Future[None] | None = None
        """The write that is under way; it outlives the journal's patience."""
        self._unshown: deque[tuple[Event, Publish]] = deque()
        self._changes: Changes = {}
        self._wake = asyncio.Event()
        self._asked = 0
        self._done = 0
        self._flushes: deque[tuple[int, asyncio.Future[None]]] = deque()
        self._watchers: list[Callable[[], None]] = []
        self.failure: str | None = None
        """Why the last write failed; None while the database can be written. No turn starts while it is set."""
        self.failed_at: float | None = None
        """Since when `failure` is set, in Unix seconds."""

    @property
    def overfull(self) -> bool:
        """Whether so much waits for the database that only what must be recorded may be added."""
        return self._unkept_bytes > MAX_BACKLOG_BYTES

    def append(self, event: Event, publish: Publish) -> None:
        """Keep an event soon and then call `publish` with it, in the order in which events were appended."""
        self._unkept.append(event)
        self._unkept_bytes += len(event.raw)
        self._unshown.append((event, publish))
        self._count(event)
        if self.failure:
            self._show(len(self._unshown))
        self._more()

    def unkept(self, session_id: str, after: int = 0, upto: float = math.inf) -> list[Event]:
        """The events of a session with `after < seq <= upto` that may not be in the database yet, in order."""
        waiting = (*self._keeping, *self._unkept)
        return [event for event in waiting if event.session_id == session_id and after < event.seq <= upto]

    def change(self, session_id: str, fields: dict[str, object]) -> None:
        """Change columns of a session's row soon."""
        self._changes.setdefault(session_id, {}).update(fields)
        self._more()

    def watch(self, changed: Callable[[], None]) -> Unwatch:
        """Call `changed` whenever `failure` is set or cleared, until the returned function is called."""
        self._watchers.append(changed)
        return lambda: self._watchers.remove(changed)

    def _more(self) -> None:
        self._asked += 1
        self._wake.set()

    async def flush(self) -> None:
        """Return when all events that were appended before this call are shown, and are written or have to wait."""
        if self._done < self._asked:
            flushed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
            self._flushes.append((self._asked, flushed))
            await flushed

    async def run(self) -> None:
        """Write until cancelled. No error ends this, because a robot that moves must stay visible."""
        try:
            while True:
                try:
                    async with asyncio.timeout(self.retry_s if self.failure else self.probe_s):
                        await self._wake.wait()
                except TimeoutError:
                    pass  # time to write again what could not be written, or to ask whether the database is there
                self._wake.clear()
                asked = self._asked
                await self._keep()
                self._done = asked
                while self._flushes and self._flushes[0][0] <= asked:
                    flushed = self._flushes.popleft()[1]
                    if not flushed.done():
                        flushed.set_result(None)
        finally:
            if self._write is not None:
                self._write.cancel()
                await asyncio.gather(self._write, return_exceptions=True)

    async def _keep(self) -> None:
        """Write the events that wait piece by piece, and show each piece; show all of them where a write fails."""
        waiting = len(self._keeping) + len(self._unkept)
        earlier = self._write is not None  # it has none of the changes that were asked for meanwhile
        while (written := await self._keep_piece()) is not None:
            waiting -= written
            if waiting <= 0 and not earlier:
                return
            earlier = False
        self._show(len(self._unshown))  # with the events that were appended meanwhile

    async def _keep_piece(self) -> int | None:
        """Write one piece, or go on waiting for the one that is under way. Returns the number of its events, or None
        where it failed or takes too long. A piece without events asks whether the database is there."""
        if self._write is None:
            self._keeping = self._next_piece()
            self._keeping_changes, self._changes = self._changes, {}
            self._write = asyncio.ensure_future(self._store.append(self._keeping, self._keeping_changes))
        await asyncio.wait({self._write}, timeout=self.patience_s)
        if not self._write.done():
            self._fail(TimeoutError("a write takes long"))
            return None
        error, self._write = self._write.exception(), None
        events, self._keeping = self._keeping, []
        if error is not None:  # of the database, its driver, the disk
            self._unkept.extendleft(reversed(events))
            self._changes = _merged(self._keeping_changes, self._changes)
            self._fail(error)
            return None
        self._unkept_bytes -= sum(len(event.raw) for event in events)
        self._recover()
        self._show(len(self._unshown) - len(self._unkept))
        return len(events)

    def _next_piece(self) -> list[Event]:
        piece: list[Event] = []
        size = 0
        while self._unkept and len(piece) < PIECE_EVENTS and size < PIECE_BYTES:
            piece.append(self._unkept.popleft())
            size += len(piece[-1].raw)
        return piece

    def _fail(self, error: BaseException) -> None:
        first = self.failure is None
        advice = (
            str(error) if isinstance(error, StoreError) else "On the robot's computer, `robot-acp doctor` says why."
        )
        self.failure = f"The session log cannot be written ({type(error).__name__}), so no task can begin. {advice}"
        if first:  # once, and not with every try
            reason = str(error) if isinstance(error, TimeoutError) else why(error)
            log.error("the session log cannot be written, and I try again every %g s: %s", self.retry_s, reason)
            self.failed_at = time.time()
            self._tell_watchers()

    def _recover(self) -> None:
        if self.failure is not None:
            log.warning("the session log can be written again")
            self.failure = self.failed_at = None
            self._tell_watchers()

    def _tell_watchers(self) -> None:
        for changed in list(self._watchers):
            changed()

    def _show(self, number: int) -> None:
        for _ in range(number):
            event, publish = self._unshown.popleft()
            publish(event)


def _merged(older: Changes, newer: Changes) -> Changes:
    return {session_id: older.get(session_id, {}) | newer.get(session_id, {}) for session_id in older | newer}
