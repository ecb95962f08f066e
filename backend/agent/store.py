"""The database of sessions: one row a session, and an append-only list of numbered events.

An event is one ACP `session/update`, kept as it was sent. Events are never changed; only `delete` removes
them, with their session. All calls run on one thread of the store's own, so that neither SQLite nor a slow
PostgreSQL ever blocks the event loop.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import orjson
import sqlalchemy as sa

log = logging.getLogger(__name__)

_metadata = sa.MetaData()

_sessions = sa.Table(
    "sessions",
    _metadata,
    sa.Column("id", sa.String(64), primary_key=True),
    sa.Column("owner", sa.String(200), nullable=False),
    sa.Column("title", sa.String(200)),
    sa.Column("cwd", sa.Text, nullable=False),
    sa.Column("mode", sa.String(40), nullable=False),
    sa.Column("model", sa.String(200), nullable=False),
    sa.Column("start_pose", sa.JSON),
    sa.Column("thought", sa.Boolean, nullable=False),
    sa.Column("motion_asks", sa.Boolean, nullable=False),
    sa.Column("created", sa.Float, nullable=False),
    sa.Column("updated", sa.Float, nullable=False, index=True),
)

_events = sa.Table(
    "events",
    _metadata,
    sa.Column("session_id", sa.String(64), sa.ForeignKey("sessions.id"), primary_key=True),
    sa.Column("seq", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("time", sa.Float, nullable=False),
    sa.Column("update", sa.LargeBinary, nullable=False),
)

_T = TypeVar("_T")
_PAGE = 200


@dataclass(frozen=True)
class SessionRow:
    """What is kept of a session besides its events. Times are Unix seconds; `start_pose` is what the robot's
    pose tool told when the session began, or None; `thought` whether a preliminary thought is made, `motion_asks`
    whether motion asks a person first where the mode would let it go."""

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


@dataclass(frozen=True)
class Event:
    """One numbered `session/update` of a session: `raw` is the update as JSON, serialised once for the log and for
    everyone attached; `origin` is the connection that must not get it back."""

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
        """The notification as one line."""
        head = b'{"jsonrpc":"2.0","method":"session/update","params":{"sessionId":' + orjson.dumps(self.session_id)
        return head + b',"update":' + self.raw + b',"_meta":{"robot-acp/seq":%d}}}\n' % self.seq


class StoreError(Exception):
    """The database cannot be used; the text says why, and never holds its URL, which can hold a password."""


class Store:
    """The sessions and events behind a SQLAlchemy URL. Open it before use, close it after."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._engine: sa.Engine | None = None
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="store")

    async def open(self) -> None:
        """Connect and make what is missing. Raises `StoreError`."""
        try:
            await self._run(self._open)
        except (sa.exc.SQLAlchemyError, ModuleNotFoundError, OSError) as error:
            log.debug("opening the database", exc_info=True)
            raise StoreError(f"The database of sessions cannot be used ({type(error).__name__}).") from error

    async def close(self) -> None:
        """Let the last write finish, then disconnect."""
        if self._engine is not None:
            await self._run(self._engine.dispose)
        self._thread.shutdown()

    async def add_session(self, row: SessionRow) -> None:
        """Keep a new session."""
        await self._write(sa.insert(_sessions).values(**vars(row)))

    async def change_session(self, session_id: str, **fields: object) -> None:
        """Change columns of a session, for instance `title` or `mode`."""
        await self._write(sa.update(_sessions).where(_sessions.c.id == session_id).values(**fields))

    async def session(self, session_id: str) -> SessionRow | None:
        """One session, or None."""
        rows = await self._read(sa.select(_sessions).where(_sessions.c.id == session_id))
        return SessionRow(**rows[0]._mapping) if rows else None

    async def sessions(self, owner: str | None, before: tuple[float, str] | None, limit: int) -> list[SessionRow]:
        """Sessions that hold at least one event, newest first; of `owner` alone unless None; `before` is the
        (updated, id) of the last one of the page before."""
        has_events = sa.exists().where(_events.c.session_id == _sessions.c.id)
        query = sa.select(_sessions).where(has_events)
        if owner is not None:
            query = query.where(_sessions.c.owner == owner)
        if before is not None:
            query = query.where(sa.tuple_(_sessions.c.updated, _sessions.c.id) < sa.tuple_(*before))
        query = query.order_by(_sessions.c.updated.desc(), _sessions.c.id.desc()).limit(limit)
        return [SessionRow(**row._mapping) for row in await self._read(query)]

    async def delete_session(self, session_id: str) -> None:
        """Remove a session and its events."""
        await self._write(
            sa.delete(_events).where(_events.c.session_id == session_id),
            sa.delete(_sessions).where(_sessions.c.id == session_id),
        )

    async def append(self, events: Sequence[Event]) -> None:
        """Keep events, of one or several sessions, in one transaction."""
        rows = [{"session_id": e.session_id, "seq": e.seq, "time": e.time, "update": e.raw} for e in events]
        latest = {e.session_id: e.time for e in events}
        await self._run(lambda: self._append(rows, latest))

    async def events(self, session_id: str, after: int = 0, upto: int | None = None) -> AsyncIterator[Event]:
        """The events with `after < seq <= upto`, in order; read page by page, so that nobody else's wait is long."""
        query = sa.select(_events).where(_events.c.session_id == session_id).order_by(_events.c.seq).limit(_PAGE)
        if upto is not None:
            query = query.where(_events.c.seq <= upto)
        while rows := await self._read(query.where(_events.c.seq > after)):
            for row in rows:
                yield Event(row.session_id, row.seq, row.time, row.update)
            after = rows[-1].seq

    def _open(self) -> None:
        url = sa.make_url(self._url)
        if url.get_backend_name() == "sqlite" and url.database:
            Path(url.database).parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        self._engine = sa.create_engine(url, pool_pre_ping=True)
        if url.get_backend_name() == "sqlite":
            with self._engine.connect() as connection:
                # Readers never wait for the writer; a commit survives the death of the process.
                connection.exec_driver_sql("PRAGMA journal_mode=WAL")
                connection.exec_driver_sql("PRAGMA synchronous=NORMAL")
        _metadata.create_all(self._engine)
        inspector = sa.inspect(self._engine)
        for table in _metadata.tables.values():
            found = {column["name"] for column in inspector.get_columns(table.name)}
            if missing := sorted(set(table.columns.keys()) - found):
                raise StoreError(
                    f"The database of sessions was made by another version of robot-acp: {table.name} has no "
                    f"{', '.join(missing)}. Move it away, or name another one with agent.database."
                )

    def _append(self, rows: list[dict[str, Any]], latest: dict[str, float]) -> None:
        with self._connected().begin() as connection:
            connection.execute(sa.insert(_events), rows)
            for session_id, updated in latest.items():
                connection.execute(sa.update(_sessions).where(_sessions.c.id == session_id).values(updated=updated))

    async def _write(self, *statements: sa.Executable) -> None:
        def work() -> None:
            with self._connected().begin() as connection:
                for statement in statements:
                    connection.execute(statement)

        await self._run(work)

    async def _read(self, query: sa.Select[Any]) -> Sequence[sa.Row[Any]]:
        def work() -> Sequence[sa.Row[Any]]:
            with self._connected().connect() as connection:
                return connection.execute(query).all()

        return await self._run(work)

    def _connected(self) -> sa.Engine:
        if self._engine is None:
            raise RuntimeError("The store is not open.")
        return self._engine

    async def _run(self, work: Callable[[], _T]) -> _T:
        return await asyncio.get_running_loop().run_in_executor(self._thread, work)
