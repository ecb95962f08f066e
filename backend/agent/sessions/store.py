"""The database of sessions: one row a session, and an append-only list of numbered events.

An event is one ACP `session/update`, kept as it was sent. Only retention changes events (it removes photos and sounds),
and only `delete_session` removes them. All calls run on the store's own thread, so that neither SQLite nor a slow
PostgreSQL blocks the event loop. Only one agent writes, so the databases' default isolation is enough: a reader that
reads page by page gets each event once.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, TypeVar

import orjson
import sqlalchemy as sa

from backend import meta as keys
from backend.agent.sessions.database import (
    StoreError,
    Text,
    add_new_columns,
    clean,
    engine_for,
    prepare_vacuum,
    why,
)
from backend.identity import person_named

log = logging.getLogger(__name__)

_metadata = sa.MetaData()


SESSIONS = sa.Table(
    "sessions",
    _metadata,
    sa.Column("id", sa.String(64), primary_key=True),
    sa.Column("owner", Text, nullable=False),
    sa.Column("owner_id", Text),  # NULL in sessions from before people had subjects
    sa.Column("title", Text),
    sa.Column("cwd", Text, nullable=False),
    sa.Column("mode", Text, nullable=False),
    sa.Column("model", Text, nullable=False),
    sa.Column("start_pose", sa.JSON(none_as_null=True)),
    sa.Column("thought", sa.Boolean, nullable=False),
    sa.Column("motion_asks", sa.Boolean, nullable=False),
    sa.Column("created", sa.Double, nullable=False),
    sa.Column("updated", sa.Double, nullable=False, index=True),
)

EVENTS = sa.Table(
    "events",
    _metadata,
    sa.Column("session_id", sa.String(64), sa.ForeignKey("sessions.id"), primary_key=True),
    sa.Column("seq", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("time", sa.Double, nullable=False),
    sa.Column("update", sa.LargeBinary, nullable=False),
)

MAX_TEXT_CHARS = 8192
"""Longer texts of a session's row are read cut: a database can contain what an older version let in."""
_ROW = sa.select(
    *(
        sa.func.substr(column, 1, MAX_TEXT_CHARS).label(column.name) if isinstance(column.type, Text) else column
        for column in SESSIONS.c
    )
)
OWNER: sa.ColumnElement[str] = sa.func.coalesce(
    SESSIONS.c.owner_id, sa.literal(person_named(""), sa.Text) + SESSIONS.c.owner
)
"""`SessionRow.person` in a query."""
_T = TypeVar("_T")
Changes = dict[str, dict[str, object]]
"""Session id -> column -> value."""
MAX_WORDS = 4
"""A search uses so many words at most; more of them only cost time."""
_PAGE = 200
ANSWER_S = 10.0
"""How long a question to the database may take, in seconds, with the wait for others' work on it."""
SILENT = (
    "The database of sessions does not answer, so no session can be opened, listed or changed now. Stop works. "
    "On the robot's computer, `robot-acp doctor` says why; try again soon."
)
PAGE_BYTES = 4 * 1024 * 1024
"""A page of events ends with the event that reaches this size; one event can be a picture of 16 MiB."""


@dataclass(frozen=True)
class SessionRow:
    """A session without its events. Times are Unix seconds. `owner` is the name of the owner, for people to read, and
    `owner_id` the person, None in sessions from before people had subjects. `start_pose` is the result of the robot's
    pose tool when the session began, None where the robot was not there. `thought` says whether turns begin with a
    preliminary thought, `motion_asks` whether motion needs permission where the mode would allow it."""

    id: str
    owner: str
    title: str | None
    cwd: str
    mode: str
    model: str
    start_pose: dict[str, Any] | None
    created: float
    updated: float
    thought: bool = True
    motion_asks: bool = False
    owner_id: str | None = None

    @property
    def person(self) -> str:
        """The owner, to compare with `Identity.person`."""
        return self.owner_id or person_named(self.owner)


@dataclass(frozen=True)
class Event:
    """One numbered `session/update` of a session: `raw` is the update as JSON, serialised once for the log and for
    everyone attached; `origin` is the connection that sent it and must not get it back."""

    session_id: str
    seq: int
    time: float
    raw: bytes
    origin: object = None

    @property
    def update(self) -> dict[str, Any]:
        """The update, parsed."""
        return dict(orjson.loads(self.raw))

    @cached_property
    def frame(self) -> bytes:
        """The ACP notification of this event, as one line."""
        head = b'{"jsonrpc":"2.0","method":"session/update","params":{"sessionId":' + orjson.dumps(self.session_id)
        meta = orjson.dumps({keys.SEQ: self.seq, keys.AT: self.time})
        return head + b',"update":' + self.raw + b',"_meta":' + meta + b"}}\n"


class Store:
    """The sessions and events behind a SQLAlchemy URL. Open it before use, close it after.

    An agent's store is the only one that writes to its database. A store with `writes=False` only reads, and can be
    open at the same time.
    """

    def __init__(self, url: str, *, writes: bool = True, page_bytes: int = PAGE_BYTES) -> None:
        self._url = url
        self._writes = writes
        self.page_bytes = page_bytes
        self.failed: Callable[[], None] = lambda: None
        """Called when a question to the database has failed."""
        self._engine: sa.Engine | None = None
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="store")
        self._searching = asyncio.Lock()
        """Only one search at a time may be on the thread, so that a write never waits behind many of them."""

    async def open(self) -> None:
        """Connect, and create the tables that are missing. Raises `StoreError`."""
        try:
            await self.run(self._open)
        except (sa.exc.SQLAlchemyError, StoreError, ImportError, OSError, ValueError) as error:
            log.debug("opening the database", exc_info=True)
            await self.close()
            raise StoreError(why(error)) from error

    async def close(self) -> None:
        """Let the last write finish, then disconnect."""
        if self._engine is not None:
            await self.run(self._engine.dispose)
        self._thread.shutdown()

    async def add_session(self, row: SessionRow) -> None:
        """Add a new session."""
        await self._write(sa.insert(SESSIONS).values(**vars(row)))

    async def change_session(self, session_id: str, **fields: object) -> None:
        """Change columns of a session, for instance `title` or `mode`."""
        await self._write(sa.update(SESSIONS).where(SESSIONS.c.id == session_id).values(**fields))

    async def session(self, session_id: str) -> SessionRow | None:
        """One session, or None."""
        if len(session_id) > 64 or clean(session_id) != session_id:
            return None  # a client made it up: our ids are plain
        rows = await self.read(_ROW.where(SESSIONS.c.id == session_id))
        return SessionRow(**rows[0]._mapping) if rows else None

    async def sessions(
        self, owner: str | None, before: tuple[float, str] | None, limit: int, search: str = ""
    ) -> list[SessionRow]:
        """At most `limit` sessions that have at least one event, newest first.

        They are those of the person `owner`, or everybody's where `owner` is None. `before` is the (updated, id) of the
        last session of the page before. Each word of `search` is in the title or in the owner's name.
        """
        has_events = sa.exists().where(EVENTS.c.session_id == SESSIONS.c.id)
        query = _ROW.where(has_events)
        if owner is not None:
            query = query.where(OWNER.in_((owner,)))
        for word in clean(search).lower().split()[:MAX_WORDS]:
            columns = (SESSIONS.c.title, SESSIONS.c.owner)
            query = query.where(sa.or_(*(sa.func.lower(c).contains(word, autoescape=True) for c in columns)))
        if before is not None:
            updated, session_id = before
            query = query.where(sa.tuple_(SESSIONS.c.updated, SESSIONS.c.id) < sa.tuple_(updated, clean(session_id)))
        query = query.order_by(SESSIONS.c.updated.desc(), SESSIONS.c.id.desc()).limit(limit)
        async with self._searching:
            return [SessionRow(**row._mapping) for row in await self.read(query)]

    async def delete_session(self, session_id: str) -> None:
        """Remove a session and its events, the last ones first and in pieces, so that other writes do not wait long."""
        this = EVENTS.c.session_id == session_id
        while (after := await self.run(partial(self._end_of_log, session_id))) is not None:
            await self._write(sa.delete(EVENTS).where(this & (EVENTS.c.seq > after)))
        await self._write(sa.delete(SESSIONS).where(SESSIONS.c.id == session_id))

    def _end_of_log(self, session_id: str) -> int | None:
        """The number before the last piece of a session's events; None where it has no events."""
        this = EVENTS.c.session_id == session_id
        sizes = sa.select(EVENTS.c.seq, sa.func.length(EVENTS.c.update)).where(this).order_by(EVENTS.c.seq.desc())
        with self.engine.connect() as connection:
            first, size = None, 0
            for seq, length in connection.execute(sizes.limit(_PAGE)):
                first, size = seq, size + length
                if size >= self.page_bytes:
                    break
            return None if first is None else first - 1

    async def copy_events(self, original: str, copy: str, upto: int) -> None:
        """Give the session `copy` the events of `original` up to number `upto`, in pieces and within the database."""
        after = 0
        while after < upto:
            page = await self.run(partial(self._page_end, original, after, upto))
            if page is None:
                return
            source = sa.select(sa.literal(copy), EVENTS.c.seq, EVENTS.c.time, EVENTS.c.update).where(
                (EVENTS.c.session_id == original) & (EVENTS.c.seq > after) & (EVENTS.c.seq <= page)
            )
            await self._write(sa.insert(EVENTS).from_select(["session_id", "seq", "time", "update"], source))
            after = page

    async def append(self, events: Sequence[Event], changes: Changes | None = None) -> None:
        """Add events, and change columns of sessions, in one transaction.

        It may be called again with the same events, for instance after a commit whose answer was lost: each event is
        kept once. Events of a session that was deleted meanwhile are dropped. Raises `StoreError` where the database
        has other events with the same numbers.
        """
        await self.run(lambda: self._append(events, changes or {}))

    async def events(self, session_id: str, after: int = 0, upto: int | None = None) -> AsyncIterator[Event]:
        """The events with `after < seq <= upto`, in order. They are read page by page, so that other calls do not wait
        long."""
        while rows := await self.run(partial(self._page, session_id, after, upto)):
            for row in rows:
                yield Event(row.session_id, row.seq, row.time, row.update)
            after = rows[-1].seq

    def _page(self, session_id: str, after: int, upto: int | None) -> Sequence[sa.Row[Any]]:
        this = (EVENTS.c.session_id == session_id) & (EVENTS.c.seq > after)
        if upto is not None:
            this &= EVENTS.c.seq <= upto
        last = self._page_end(session_id, after, upto)
        if last is None:
            return ()
        with self.engine.connect() as connection:
            page = sa.select(EVENTS).where(this & (EVENTS.c.seq <= last)).order_by(EVENTS.c.seq)
            return connection.execute(page).all()

    def _page_end(self, session_id: str, after: int, upto: int | None) -> int | None:
        """The number of the last event of the page that begins after `after`; None where there is no event."""
        this = (EVENTS.c.session_id == session_id) & (EVENTS.c.seq > after)
        if upto is not None:
            this &= EVENTS.c.seq <= upto
        sizes = sa.select(EVENTS.c.seq, sa.func.length(EVENTS.c.update)).where(this).order_by(EVENTS.c.seq)
        with self.engine.connect() as connection:
            last, size = None, 0
            for seq, length in connection.execute(sizes.limit(_PAGE)):
                last, size = seq, size + length
                if size >= self.page_bytes:
                    break
            return last

    def _open(self) -> None:
        self._engine = engine_for(self._url, alone=self._writes, serialise=lambda value: as_json(value).decode())
        _metadata.create_all(self._engine)
        add_new_columns(_metadata, self._engine)
        inspector = sa.inspect(self._engine)
        for table in _metadata.tables.values():
            found = {column["name"] for column in inspector.get_columns(table.name)}
            if missing := sorted(set(table.columns.keys()) - found):
                raise StoreError(
                    f"The database of sessions was made by another version of robot-acp: {table.name} has no "
                    f"{', '.join(missing)}. Move it away, or name another one with agent.database."
                )
        if self._writes and self._engine.dialect.name == "sqlite":
            prepare_vacuum(self._engine)

    def _append(self, events: Sequence[Event], changes: Changes) -> None:
        try:
            self._insert(events, changes)
        except sa.exc.IntegrityError:
            self._insert(self._still_to_keep(events), changes)

    def _insert(self, events: Sequence[Event], changes: Changes) -> None:
        rows = [{"session_id": e.session_id, "seq": e.seq, "time": e.time, "update": e.raw} for e in events]
        latest = {e.session_id: e.time for e in events}
        with self.engine.begin() as connection:
            if not events and not changes:
                connection.execute(sa.select(SESSIONS.c.id).limit(1)).all()  # asks whether the database is there
            for session_id, fields in changes.items():
                connection.execute(sa.update(SESSIONS).where(SESSIONS.c.id == session_id).values(**fields))
            if rows:
                connection.execute(sa.insert(EVENTS), rows)
            for session_id, updated in latest.items():
                this = (SESSIONS.c.id == session_id) & (SESSIONS.c.updated < updated)
                connection.execute(sa.update(SESSIONS).where(this).values(updated=updated))

    def _still_to_keep(self, events: Sequence[Event]) -> list[Event]:
        """The events that are not in the database yet and whose session exists.

        An event that is there already must be the same one. Raises `StoreError` where another program has written
        another event with the number of one of ours.
        """
        missing: list[Event] = []
        with self.engine.connect() as connection:
            for session_id in {event.session_id for event in events}:
                if connection.execute(sa.select(SESSIONS.c.id).where(SESSIONS.c.id == session_id)).first() is None:
                    log.warning("events of the session %s are dropped: it was deleted", session_id)
                    continue
                ours = [event for event in events if event.session_id == session_id]
                since = (EVENTS.c.session_id == session_id) & (EVENTS.c.seq >= min(event.seq for event in ours))
                kept = {row.seq: (row.time, row.update) for row in connection.execute(sa.select(EVENTS).where(since))}
                if any(kept.get(event.seq, (event.time, event.raw)) != (event.time, event.raw) for event in ours):
                    raise StoreError(f"Another program has written to the session {session_id}. Restart the agent.")
                missing += [event for event in ours if event.seq not in kept]
        return missing

    async def _write(self, *statements: sa.Executable) -> None:
        def work() -> None:
            with self.engine.begin() as connection:
                for statement in statements:
                    connection.execute(statement)

        with self._reported():
            await self.run(work)

    async def read(self, query: sa.Select[Any]) -> Sequence[sa.Row[Any]]:
        """The rows of a query. Raises `StoreError` where the database takes longer than `ANSWER_S`."""

        def work() -> Sequence[sa.Row[Any]]:
            with self.engine.connect() as connection:
                return connection.execute(query).all()

        try:
            with self._reported():
                async with asyncio.timeout(ANSWER_S):
                    return await self.run(work)
        except TimeoutError:
            raise StoreError(SILENT) from None

    @contextlib.contextmanager
    def _reported(self) -> Iterator[None]:
        try:
            yield
        except (sa.exc.SQLAlchemyError, TimeoutError):
            self.failed()
            raise

    @property
    def engine(self) -> sa.Engine:
        """The connections, for the store's thread. Raises `RuntimeError` before `open`."""
        if self._engine is None:
            raise RuntimeError("The store is not open.")
        return self._engine

    async def run(self, work: Callable[[], _T]) -> _T:
        """Do `work` on the store's thread."""
        return await asyncio.get_running_loop().run_in_executor(self._thread, work)


def as_json(value: object) -> bytes:
    """A value as JSON. Where a model or a server made a value that JSON does not have, it becomes a similar one: a
    single surrogate a question mark, a very large integer a float, NaN null."""
    try:
        return orjson.dumps(value)
    except TypeError:
        text = json.dumps(value, ensure_ascii=False, default=str).encode("utf-8", "replace")
        return orjson.dumps(json.loads(text, parse_int=_number, parse_constant=lambda _name: None))


def _number(digits: str) -> float:
    return int(digits) if len(digits) < 19 else float(digits)
