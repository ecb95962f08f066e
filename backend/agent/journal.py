"""Numbers the events of all sessions, keeps them, and only then shows them: durable before visible.

`append` never waits: whoever has something to tell goes on at once, and events that come while a write is
under way share the next one. So `kill -9` loses no event that any client has seen.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from typing import Any

from sqlalchemy.exc import SQLAlchemyError

from backend.agent.store import Event, Store

log = logging.getLogger(__name__)


class Journal:
    """The one writer of events. `run` must be running for anything to be kept or shown."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._waiting: list[tuple[Event, Callable[[Event], None]]] = []
        self._changes: dict[str, dict[str, object]] = {}
        self._wake = asyncio.Event()
        self._idle = asyncio.Event()
        self._idle.set()
        self.failure: str | None = None
        """Why the last write failed; None while all is kept. No turn starts while it is set."""

    def append(
        self,
        session_id: str,
        seq: int,
        update: dict[str, Any],
        publish: Callable[[Event], None],
        origin: object = None,
    ) -> None:
        """Keep an event soon, then hand it to `publish`, in the order of the calls."""
        self._waiting.append((Event(session_id, seq, time.time(), update, origin), publish))
        self._idle.clear()
        self._wake.set()

    def change(self, session_id: str, fields: dict[str, object]) -> None:
        """Change columns of a session's row soon."""
        self._changes.setdefault(session_id, {}).update(fields)
        self._idle.clear()
        self._wake.set()

    async def flush(self) -> None:
        """Return when all that was appended so far has been kept and shown."""
        await self._idle.wait()

    async def run(self) -> None:
        """Write until cancelled."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            batch, self._waiting = self._waiting, []
            changes, self._changes = self._changes, {}
            await self._keep([event for event, _ in batch], changes)
            for event, publish in batch:
                publish(event)
            if not self._waiting and not self._changes:
                self._idle.set()

    async def _keep(self, events: list[Event], changes: dict[str, dict[str, object]]) -> None:
        try:
            for session_id, fields in changes.items():
                await self._store.change_session(session_id, **fields)
            if events:
                await self._store.append(events)
            self.failure = None
        except SQLAlchemyError as error:
            # People who watch a moving robot must go on seeing it, so the events are shown all the same.
            log.exception("could not write %d events", len(events))
            self.failure = f"The session log cannot be written ({type(error).__name__})."
