"""Connects to the database of sessions, SQLite in a file or PostgreSQL by URL, and tells in words why it cannot.

A robot has one agent, so one agent at a time writes to its database: only then are the numbers of events, the
lease and "this turn was interrupted" true. Whoever writes holds a lock, which ends with its process. Nothing here
may put the URL into a text: it can hold a password.
"""

from __future__ import annotations

import fcntl
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import sqlalchemy as sa

LOCK_LOOK_S = 0.05
LOCK_PATIENCE_S = 5.0
"""How long a new agent waits for the lock: the server may not have noticed yet that the one before it died."""
POSTGRES_LOCK = int.from_bytes(b"robotacp")
TAKEN = (
    "Another agent is using the database of sessions, and a robot has one agent. Reach that one with "
    "`robot-acp chat` or `robot-acp connect`, or give this one a database of its own with agent.database."
)
_POSTGRES_URL = {
    # A server that is gone without a word is given up after seconds, not after the quarter of an hour of TCP.
    "connect_timeout": "5",
    "keepalives_idle": "5",
    "keepalives_interval": "2",
    "keepalives_count": "3",
    "tcp_user_timeout": "10000",
    "application_name": "robot-acp",
}
_POSTGRES_SESSION = (
    # And the server gives up an agent that is gone, so that the next one gets the lock; and a wait for a table.
    "SET tcp_keepalives_idle = 10",
    "SET tcp_keepalives_interval = 5",
    "SET tcp_keepalives_count = 3",
    "SET statement_timeout = '10s'",
)
_SQLITE_SESSION = (
    # Readers never wait for the writer; a commit survives the death of the process; events need their session.
    "PRAGMA journal_mode=WAL",
    "PRAGMA synchronous=NORMAL",
    "PRAGMA foreign_keys=ON",
)


class StoreError(Exception):
    """The database cannot be used; the text says why, and never holds its URL, which can hold a password."""


def engine_for(database_url: str, *, alone: bool, serialise: Callable[[object], str]) -> sa.Engine:
    """An engine that has not connected yet. With `alone`, connecting raises `StoreError` while another agent writes.

    Raises what SQLAlchemy raises for a URL; `why` puts it into words.
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
        file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    # What people said is in the parameters of a statement, and errors go to the log.
    engine = sa.create_engine(url, pool_pre_ping=True, hide_parameters=True, json_serializer=serialise)
    settings = {"sqlite": _SQLITE_SESSION, "postgresql": _POSTGRES_SESSION}.get(backend, ())

    @sa.event.listens_for(engine, "connect")
    def prepare(connection: Any, record: Any) -> None:
        try:
            if backend == "sqlite":  # its own knows the letters of English alone
                connection.create_function("lower", 1, _lower, deterministic=True)
            cursor = connection.cursor()
            for statement in settings:
                cursor.execute(statement)
            connection.commit()
            if alone and backend == "postgresql":
                _take(lambda: _lock_postgres(connection))
            elif alone and file is not None:
                record.info["lock"] = lock = file.with_name(f"{file.name}-agent").open("w")
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


def why(error: Exception) -> str:
    """Why a database could not be opened, and what to do, in one sentence without the URL."""
    start = "The database of sessions cannot be used: "
    match error:
        case StoreError():
            return str(error)
        case sa.exc.NoSuchModuleError():
            return start + "agent.database begins with no known kind; use sqlite:/// or postgresql://."
        case sa.exc.DBAPIError() if error.orig is not None:
            # The first line: what follows repeats the statement, or guesses.
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
        time.sleep(LOCK_LOOK_S)  # on the thread of the store, which nobody else waits for yet


def _lock_postgres(connection: Any) -> bool:
    """The lock belongs to the connection, beyond its transactions."""
    cursor = connection.cursor()
    cursor.execute("SELECT pg_try_advisory_lock(%s)", (POSTGRES_LOCK,))
    taken = bool(cursor.fetchone()[0])
    connection.commit()
    return taken


def _lock_file(file: Any) -> bool:
    """The lock is on a file of its own: SQLite has locks of its own on the database."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
