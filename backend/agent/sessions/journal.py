"""Keeps the events of all sessions, and only then shows them: durable before visible.

`append` never waits: whoever has something to tell goes on at once, and events that come while a write is under way
share the next one. So `kill -9` loses no event that any client has seen. While the database cannot be written, what
happens is shown at once and kept when it can be: people must go on seeing a robot that moves.
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
PATIENCE_S = 2.0
"""A write that takes longer has failed, for those who watch. It may still succeed: an event that is kept twice is kept
once."""

Publish = Callable[[Event], None]


class Journal:
    """The one writer of events. `run` must be running for anything to be kept or shown."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._unkept: list[Event] = []
        self._keeping: list[Event] = []
        """What the write that is under way keeps."""
        self._unshown: deque[tuple[Event, Publish]] = deque()
        self._changes: Changes = {}
        self._wake = asyncio.Event()
        self._asked = 0
        self._done = 0
        self._flushes: deque[tuple[int, asyncio.Future[None]]] = deque()
        self.failure: str | None = None
        """Why the last write failed; None while all is kept. No turn starts while it is set."""

    def append(self, event: Event, publish: Publish) -> None:
        """Keep an event soon, then hand it to `publish`, in the order of the calls."""
        self._unkept.append(event)
        self._unshown.append((event, publish))
        if self.failure:
            self._show(len(self._unshown))
        self._more()

    def unkept(self, session_id: str, after: int = 0, upto: float = math.inf) -> list[Event]:
        """The events of a session with `after < seq <= upto` that nobody knows to be kept, in order."""
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
        """Return when all that was appended before this call has been shown, and kept or once tried to be."""
        if self._done < self._asked:
            flushed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
            self._flushes.append((self._asked, flushed))
            await flushed

    async def run(self) -> None:
        """Write until cancelled. No error ends it: a robot that moves must stay visible."""
        while True:
            try:
                async with asyncio.timeout(RETRY_S if self.failure else None):
                    await self._wake.wait()
            except TimeoutError:
                pass  # time to try again what could not be written
            self._wake.clear()
            asked = self._asked
            await self._keep()
            self._done = asked
            while self._flushes and self._flushes[0][0] <= asked:
                flushed = self._flushes.popleft()[1]
                if not flushed.done():
                    flushed.set_result(None)

    async def _keep(self) -> None:
        """Write all that waits, then show it; where it cannot be written, show it all the same."""
        events, self._unkept = self._unkept, []
        self._keeping = events
        changes, self._changes = self._changes, {}
        unshown = len(self._unshown)
        try:
            async with asyncio.timeout(PATIENCE_S):
                await self._store.append(events, changes)
        except Exception as error:  # of the database, its driver, the disk
            log.error("could not write %d events: %s", len(events), str(error) or type(error).__name__)
            reason = str(error) if isinstance(error, StoreError) else "Look at the agent's log."
            self.failure = f"The session log cannot be written ({type(error).__name__}). {reason}"
            self._unkept = events + self._unkept
            self._changes = _merged(changes, self._changes)
            unshown = len(self._unshown)  # with what came meanwhile
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
