"""Keeps the events of all sessions, and only then shows them: durable before visible.

`append` never waits: whoever has something to tell goes on at once, and events that come while a write is under way
share the next one. So `kill -9` loses no event that any client has seen.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable

from backend.agent.store import Event, Store

log = logging.getLogger(__name__)

RETRY_S = 1.0

Publish = Callable[[Event], None]
Changes = dict[str, dict[str, object]]


class Journal:
    """The one writer of events. `run` must be running for anything to be kept or shown."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._waiting: list[tuple[Event, Publish]] = []
        self._changes: Changes = {}
        self._unkept: list[Event] = []
        """Events that were shown although the last write failed; the next write begins with them."""
        self._wake = asyncio.Event()
        self._asked = 0
        self._done = 0
        self._flushes: deque[tuple[int, asyncio.Future[None]]] = deque()
        self.failure: str | None = None
        """Why the last write failed; None while all is kept. No turn starts while it is set."""

    def append(self, event: Event, publish: Publish) -> None:
        """Keep an event soon, then hand it to `publish`, in the order of the calls."""
        self._waiting.append((event, publish))
        self._more()

    def change(self, session_id: str, fields: dict[str, object]) -> None:
        """Change columns of a session's row soon."""
        self._changes.setdefault(session_id, {}).update(fields)
        self._more()

    def _more(self) -> None:
        self._asked += 1
        self._wake.set()

    async def flush(self) -> None:
        """Return when all that was appended before this call has been kept and shown."""
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
            batch, self._waiting = self._waiting, []
            changes, self._changes = self._changes, {}
            await self._keep([event for event, _ in batch], changes)
            for event, publish in batch:
                publish(event)
            self._done = asked
            while self._flushes and self._flushes[0][0] <= asked:
                flushed = self._flushes.popleft()[1]
                if not flushed.done():
                    flushed.set_result(None)

    async def _keep(self, events: list[Event], changes: Changes) -> None:
        unkept, self._unkept = self._unkept + events, []
        try:
            for session_id in list(changes):
                await self._store.change_session(session_id, **changes[session_id])
                del changes[session_id]
            if unkept:
                await self._store.append(unkept)
            if self.failure:
                log.warning("the session log can be written again")
            self.failure = None
        except Exception as error:  # of the database, its driver, the disk: people must go on seeing the robot
            log.error("could not write %d events: %s", len(unkept), error)
            self.failure = f"The session log cannot be written ({type(error).__name__}). Look at the agent's log."
            self._unkept = unkept
            self._changes = changes | self._changes
