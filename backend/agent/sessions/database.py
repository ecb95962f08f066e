"""Connects to the database of sessions, SQLite in a file or PostgreSQL by URL, or says in words why it cannot.

A robot has one agent, so one agent at a time writes to its database: only then are the numbers of events, the
lease and "this turn was interrupted" true. The agent that writes has a lock, which ends with its process. Nothing here
may put the URL into a text, because the URL can contain a password.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from backend import private_files

LOCK_RETRY_S = 0.05
LOCK_PATIENCE_S = 5.0
"""How long a new agent waits for the lock: the server may not have noticed yet that the one before it died."""
POSTGRES_LOCK = int.from_bytes(b"robotacp")
TAKEN = (
    "Another agent is using the database of sessions, and a robot has one agent. Reach that one with "
    "`robot-acp chat` or `robot-acp connect`, or give this one a database of its own with agent.database."
)
_POSTGRES_URL = {
    # A connection to a server that is gone ends after seconds, not after the quarter of an hour that TCP takes.
    "connect_timeout": "5",
    "keepalives_idle": "5",
    "keepalives_interval": "2",
    "keepalives_count": "3",
    "tcp_user_timeout": "10000",
    "application_name": "robot-acp",
}
_POSTGRES_SESSION = (
    # The server ends the connection of an agent that is gone, so that the next agent gets the lock. It also ends a
    # statement that waits for a table.
    "SET tcp_keepalives_idle = 10",
    "SET tcp_keepalives_interval = 5",
    "SET tcp_keepalives_count = 3",
    "SET statement_timeout = '10s'",
)
_SQLITE_SESSION = (
    # Only before the first table, and for a later VACUUM: what is deleted can be given back to the disk step by step.
    "PRAGMA auto_vacuum=INCREMENTAL",
    "PRAGMA journal_size_limit=4194304",
    # Readers never wait for the writer. A commit survives the end of the process. An event needs its session.
    "PRAGMA journal_mode=WAL",
    "PRAGMA synchronous=NORMAL",
    "PRAGMA foreign_keys=ON",
)


class StoreError(Exception):
    """The database cannot be used. The text says why and never contains the URL, which can contain a password."""


def engine_for(database_url: str, *, alone: bool, serialise: Callable[[object], str]) -> sa.Engine:
    """An engine that has not connected yet. With `alone`, connecting raises `StoreError` while another agent writes.

    `serialise` makes the JSON of a column. Raises SQLAlchemy's exception for a wrong URL; `why` puts it into words.
    """
    url = sa.make_url(database_url)
    if url.drivername in ("postgresql", "postgres"):  # as people write it, and as hosting services hand it out
        url = url.set(drivername="postgresql+psycopg")
    backend = url.get_backend_name()
    if backend == "postgresql" and "@" in (url.host or ""):
        raise StoreError("In agent.database, write %40 for an @ in the name or the password.")
    if url.get_driver_name().startswith("psycopg"):
        url = url.set(query={**_POSTGRES_URL, **url.query})
    file = None
    if backend == "sqlite" and url.database and not url.database.startswith((":memory:", "file:")):
        file = Path(url.database)
    if file is not None:
        private_files.make_folder(file.parent)
        for name in (file.name, f"{file.name}-wal", f"{file.name}-shm"):  # SQLite gives new ones the mode of the first
            if name == file.name or file.with_name(name).exists():
                private_files.restrict(file.with_name(name))
    # Errors go to the log, and the parameters of a statement contain what people said.
    engine = sa.create_engine(url, pool_pre_ping=True, hide_parameters=True, json_serializer=serialise)
    settings = {"sqlite": _SQLITE_SESSION, "postgresql": _POSTGRES_SESSION}.get(backend, ())

    @sa.event.listens_for(engine, "connect")
    def prepare(connection: Any, record: Any) -> None:
        try:
            if backend == "sqlite":  # SQLite's own knows only the letters of English
                connection.create_function("lower", 1, _lower, deterministic=True)
            cursor = connection.cursor()
            for statement in settings:
                cursor.execute(statement)
            connection.commit()
            if alone and backend == "postgresql":
                _take(lambda: _lock_postgres(connection))
            elif alone and file is not None:
                lock_file = file.with_name(f"{file.name}-agent")
                private_files.restrict(lock_file)
                record.info["lock"] = lock = lock_file.open("r")
                _take(lambda: _lock_file(lock))
        except BaseException:
            release(connection, record)
            connection.close()
            raise

    @sa.event.listens_for(engine, "close")
    def release(_connection: Any, record: Any) -> None:
        if record is not None and (lock := record.info.pop("lock", None)):
            lock.close()

    return engine


def examine(database_url: str) -> str:
    """What `robot-acp doctor` says of a database that can be used. Changes nothing: a file that is not there yet is
    not made. Raises what `why` puts into words."""
    url = sa.make_url(database_url)
    if url.get_backend_name() == "sqlite" and url.database and not Path(url.database).exists():
        folder = next(place for place in Path(url.database).absolute().parents if place.exists())
        if not os.access(folder, os.W_OK | os.X_OK):
            raise StoreError(f"The database of sessions cannot be made: {folder} cannot be written.")
        return "it will be made when the agent starts"
    engine = engine_for(database_url, alone=False, serialise=str)
    try:
        with engine.connect() as connection:
            tables = sa.inspect(connection).get_table_names()
            if "sessions" not in tables:
                return "it answers, and is empty"
            if url.get_backend_name() == "sqlite":
                connection.connection.executescript("BEGIN IMMEDIATE; ROLLBACK")  # whether it can be written
            number = connection.execute(sa.text("SELECT count(*) FROM sessions")).scalar()
            return f"it answers, with {number} sessions"
    finally:
        engine.dispose()


VACUUM_AT_ONCE_BYTES = 64 * 1024 * 1024
"""A SQLite file of an older version is rewritten when it is opened, if it is not larger: that takes about a second."""
_VACUUM_PAGES = 256


def prepare_vacuum(engine: sa.Engine) -> None:
    """Rewrite a SQLite file that was made without incremental vacuum, so that its space can be given back. A large one
    is left as it is: deleted space is used again, and `robot-acp sessions compact` rewrites it."""
    with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        mode = connection.execute(sa.text("PRAGMA auto_vacuum")).scalar()
        pages = connection.execute(sa.text("PRAGMA page_count")).scalar() or 0
        size = connection.execute(sa.text("PRAGMA page_size")).scalar() or 0
        if mode == 0 and pages * size <= VACUUM_AT_ONCE_BYTES:
            with contextlib.suppress(sa.exc.OperationalError):  # somebody reads it
                connection.execute(sa.text("VACUUM"))


def vacuum_step(engine: sa.Engine) -> bool:
    """Give about a megabyte of free space of a SQLite file back to the disk; false when none is left."""
    with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        free = connection.execute(sa.text("PRAGMA freelist_count")).scalar() or 0
        if free:
            # As a script: it is a statement without rows that has to be stepped once for each page.
            connection.connection.executescript(f"PRAGMA incremental_vacuum({_VACUUM_PAGES})")
            left = connection.execute(sa.text("PRAGMA freelist_count")).scalar() or 0
            if 0 < left < free:
                return True
        connection.execute(sa.text("PRAGMA wal_checkpoint(PASSIVE)")).all()
        return False


def why(error: BaseException) -> str:
    """Why a database could not be opened, and what to do, in one sentence without the URL."""
    start = "The database of sessions cannot be used: "
    match error:
        case StoreError():
            return str(error)
        case sa.exc.NoSuchModuleError():
            return start + "agent.database begins with no known kind; use sqlite:/// or postgresql://."
        case sa.exc.DBAPIError() if error.orig is not None:
            # Only the first line: the others repeat the statement, or guess.
            reason = (str(error.orig).strip().splitlines() or [type(error.orig).__name__])[0]
            return f"{start}{reason.removeprefix('connection failed: ').rstrip('.')}. Check agent.database."
        case ImportError() if error.name in ("psycopg", None):
            return start + "PostgreSQL needs its driver; install it with `pip install 'robot-acp[postgres]'`."
        case ImportError():
            return start + f"its driver is not installed (Python package {error.name})."
        case OSError():
            return start + f"{error.strerror or type(error).__name__}."
        case sa.exc.ArgumentError() | ValueError():
            return start + "agent.database is no URL such as postgresql://NAME:PASSWORD@HOST:5432/DATABASE."
        case _:
            return start + f"{type(error).__name__}."


def _lower(text: str | None) -> str | None:
    return None if text is None else text.lower()


def _take(lock: Callable[[], bool]) -> None:
    deadline = time.monotonic() + LOCK_PATIENCE_S
    while not lock():
        if time.monotonic() > deadline:
            raise StoreError(TAKEN)
        time.sleep(LOCK_RETRY_S)  # on the thread of the store, for which nobody else waits yet


def _lock_postgres(connection: Any) -> bool:
    """Whether the lock was free. It belongs to the connection and outlives its transactions."""
    cursor = connection.cursor()
    cursor.execute("SELECT pg_try_advisory_lock(%s)", (POSTGRES_LOCK,))
    taken = bool(cursor.fetchone()[0])
    connection.commit()
    return taken


def _lock_file(file: Any) -> bool:
    """Whether the lock was free. It is on a separate file, because SQLite locks the database file itself."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


class Text(sa.TypeDecorator[str]):
    """Text that every database accepts: without NUL, which PostgreSQL refuses, and without single surrogates, which
    are no UTF-8. So no name and no title can prevent the log from being written."""

    impl = sa.Text
    cache_ok = True

    def process_bind_param(self, value: str | None, dialect: sa.Dialect) -> str | None:
        del dialect
        return None if value is None else clean(value)


def add_new_columns(metadata: sa.MetaData, engine: sa.Engine) -> None:
    """Add the columns that a database of an earlier version lacks and that may be empty. Raises SQLAlchemy's errors."""
    inspector = sa.inspect(engine)
    for table in metadata.tables.values():
        found = {column["name"] for column in inspector.get_columns(table.name)}
        for column in table.columns:
            if column.nullable and column.name not in found:
                kind = column.type.compile(engine.dialect)
                with engine.begin() as connection:
                    connection.execute(sa.text(f"ALTER TABLE {table.name} ADD COLUMN {column.name} {kind}"))


def clean(text: str) -> str:
    """The text without what databases do not take: zero bytes and single surrogates."""
    return text.replace("\0", "").encode("utf-8", "replace").decode()
