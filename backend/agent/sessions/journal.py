"""Writes the events of all sessions to the database, and shows each event only after that: durable before visible.

So `kill -9` loses no event that any client has seen. `append` never waits, and the events that are appended during a
write share the next one. While the database cannot be written, events are shown at once and written later, because
people must go on seeing a robot that moves.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections import deque
from collections.abc import Callable

from backend.agent.sessions.database import StoreError
from backend.agent.sessions.store import Changes, Event, Store

log = logging.getLogger(__name__)

RETRY_S = 1.0
"""After a write that failed, the next one begins at the latest after so many seconds."""
PATIENCE_S = 2.0
"""A write that takes longer counts as failed, so that people go on seeing what happens. It may still succeed: `Store`
keeps an event once, also where it is written twice."""

Publish = Callable[[Event], None]


class Journal:
    """The only writer of events. Events are kept and shown only while `run` is running."""

    def __init__(self, store: Store, *, retry_s: float = RETRY_S, patience_s: float = PATIENCE_S) -> None:
        self.retry_s = retry_s
        self.patience_s = patience_s
        self._store = store
        self._unkept: list[Event] = []
        self._keeping: list[Event] = []
        """The events of the write that is under way."""
        self._unshown: deque[tuple[Event, Publish]] = deque()
        self._changes: Changes = {}
        self._wake = asyncio.Event()
        self._asked = 0
        self._done = 0
        self._flushes: deque[tuple[int, asyncio.Future[None]]] = deque()
        self.failure: str | None = None
        """Why the last write failed; None while the database can be written. No turn starts while it is set."""

    def append(self, event: Event, publish: Publish) -> None:
        """Keep an event soon and then call `publish` with it, in the order in which events were appended."""
        self._unkept.append(event)
        self._unshown.append((event, publish))
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

    def _more(self) -> None:
        self._asked += 1
        self._wake.set()

    async def flush(self) -> None:
        """Return when all events that were appended before this call are shown, and one write of them has ended."""
        if self._done < self._asked:
            flushed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
            self._flushes.append((self._asked, flushed))
            await flushed

    async def run(self) -> None:
        """Write until cancelled. No error ends this, because a robot that moves must stay visible."""
        while True:
            try:
                async with asyncio.timeout(self.retry_s if self.failure else None):
                    await self._wake.wait()
            except TimeoutError:
                pass  # time to write again what could not be written
            self._wake.clear()
            asked = self._asked
            await self._keep()
            self._done = asked
            while self._flushes and self._flushes[0][0] <= asked:
                flushed = self._flushes.popleft()[1]
                if not flushed.done():
                    flushed.set_result(None)

    async def _keep(self) -> None:
        """Write the events that wait, then show them, also where the write failed."""
        events, self._unkept = self._unkept, []
        self._keeping = events
        changes, self._changes = self._changes, {}
        unshown = len(self._unshown)
        try:
            async with asyncio.timeout(self.patience_s):
                await self._store.append(events, changes)
        except Exception as error:  # of the database, its driver, the disk
            log.error("could not write %d events: %s", len(events), str(error) or type(error).__name__)
            reason = str(error) if isinstance(error, StoreError) else "Look at the agent's log."
            self.failure = f"The session log cannot be written ({type(error).__name__}). {reason}"
            self._unkept = events + self._unkept
            self._changes = _merged(changes, self._changes)
            unshown = len(self._unshown)  # with the events that were appended meanwhile
        else:
            if self.failure:
                log.warning("the session log can be written again")
            self.failure = None
        self._keeping = []
        self._show(unshown)

    def _show(self, number: int) -> None:
        for _ in range(number):
            event, publish = self._unshown.popleft()
            publish(event)


def _merged(older: Changes, newer: Changes) -> Changes:
    return {session_id: older.get(session_id, {}) | newer.get(session_id, {}) for session_id in older | newer}
