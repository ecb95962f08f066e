"""Databases for tests: each test gets an empty one, SQLite in a file, or PostgreSQL in a server of the run's own.

The server listens on the loopback, lives in a folder of its own and ends with the test run. Where PostgreSQL is not
installed its tests are skipped, and pytest says so.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import pwd
import shutil
import sqlite3
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import pytest

from backend.agent.sessions import database as database_module
from tests.processes import free_port

PASSWORD = "hunter2"
KINDS = ("sqlite", "postgresql")


class Database(Protocol):
    """An empty database, and ways in which it can fail."""

    @property
    def url(self) -> str: ...

    def execute(self, statement: str) -> list[Any]:
        """Run a statement as another program would, and return the rows."""

    def away(self) -> contextlib.AbstractContextManager[None]:
        """Nothing can be written while the context lasts, and every try fails."""

    def hanging(self) -> contextlib.AbstractContextManager[None]:
        """A write waits while the context lasts."""


@dataclass
class SQLite:
    """A file."""

    file: Path

    @property
    def url(self) -> str:
        return f"sqlite:///{self.file}"

    def execute(self, statement: str) -> list[Any]:
        with contextlib.closing(sqlite3.connect(self.file)) as connection, connection:
            return connection.execute(statement).fetchall()

    @contextlib.contextmanager
    def hanging(self) -> Iterator[None]:
        with contextlib.closing(sqlite3.connect(self.file, isolation_level=None)) as connection:
            connection.execute("BEGIN IMMEDIATE")
            yield

    away = hanging


@dataclass
class Cluster:
    """A PostgreSQL server: its programs, its folder, its port."""

    programs: Path
    folder: Path
    port: int = field(default_factory=free_port)
    _numbers: Iterator[int] = field(default_factory=itertools.count)

    @property
    def _user(self) -> dict[str, Any]:
        """PostgreSQL refuses to run as root."""
        if os.geteuid() != 0:
            return {}
        who = _unprivileged()
        return {"user": who.pw_uid, "group": who.pw_gid, "extra_groups": []}

    def _run(self, program: str, *arguments: str) -> None:
        subprocess.run(
            [self.programs / program, *arguments],
            check=True,
            stdout=subprocess.DEVNULL,
            stdin=subprocess.DEVNULL,
            cwd=self.folder,
            **self._user,
        )

    def create(self) -> None:
        password = self.folder / "password"
        password.write_text(PASSWORD)
        if self._user:
            for path in (self.folder, password):
                os.chown(path, self._user["user"], self._user["group"])
        options = ["--no-sync", "--encoding=UTF8", "--locale=C", "--username=robot"]
        self._run("initdb", "-D", "data", "--auth=scram-sha-256", f"--pwfile={password}", *options)

    def start(self) -> None:
        options = f"-p {self.port} -c listen_addresses=127.0.0.1 -c unix_socket_directories= -c fsync=off"
        self._run("pg_ctl", "-D", "data", "-l", "log", "-o", options, "-w", "start")

    def stop(self) -> None:
        self._run("pg_ctl", "-D", "data", "-m", "immediate", "-w", "stop")

    def url(self, name: str) -> str:
        return f"postgresql://robot:{PASSWORD}@127.0.0.1:{self.port}/{name}"

    def connect(self, name: str = "postgres") -> Any:
        import psycopg

        return psycopg.connect(self.url(name), autocommit=True)

    @contextlib.contextmanager
    def new_database(self) -> Iterator[PostgreSQL]:
        name = f"test{next(self._numbers)}"
        with self.connect() as connection:
            connection.execute(f"CREATE DATABASE {name}")
        yield PostgreSQL(self, name)
        with self.connect() as connection:
            connection.execute(f"DROP DATABASE {name} WITH (FORCE)")


@dataclass
class PostgreSQL:
    """A database of the run's server."""

    cluster: Cluster
    name: str

    @property
    def url(self) -> str:
        return self.cluster.url(self.name)

    def execute(self, statement: str) -> list[Any]:
        with self.cluster.connect(self.name) as connection:
            cursor = connection.execute(statement)
            return cursor.fetchall() if cursor.description else []

    @contextlib.contextmanager
    def away(self) -> Iterator[None]:
        self.cluster.stop()
        try:
            yield
        finally:
            self.cluster.start()

    @contextlib.contextmanager
    def hanging(self) -> Iterator[None]:
        with self.cluster.connect(self.name) as connection, connection.transaction():
            connection.execute("LOCK TABLE events, sessions IN ACCESS EXCLUSIVE MODE")
            yield

    def cut_connections(self) -> int:
        """End the agent's, as an administrator does, or a proxy that ends what was idle; return how many."""
        ours = (
            "SELECT pg_terminate_backend(pid, 5000) FROM pg_stat_activity"
            " WHERE application_name = 'robot-acp' AND datname = current_database()"
        )
        return len(self.execute(ours))


@pytest.fixture(scope="session")
def postgres() -> Iterator[Cluster]:
    """The PostgreSQL server of this test run."""
    pytest.importorskip("psycopg", reason="the PostgreSQL driver is not installed: pip install 'robot-acp[postgres]'")
    programs = _programs()
    if programs is None:
        pytest.skip("no PostgreSQL server is installed (no initdb on PATH or in /usr/lib/postgresql)")
    folder = Path(tempfile.mkdtemp(prefix="robot-acp-pg-"))  # where an unprivileged user can reach it
    cluster = Cluster(programs, folder)
    try:
        cluster.create()
        cluster.start()
        yield cluster
        cluster.stop()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(params=KINDS)
def database(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Database]:
    """An empty database: the test runs once on each kind."""
    if request.param == "sqlite":
        yield SQLite(tmp_path / "sessions.db")
    else:
        with request.getfixturevalue("postgres").new_database() as database:
            yield database


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever finds the database in use gives up at once."""
    monkeypatch.setattr(database_module, "LOCK_PATIENCE_S", 0.0)


def _programs() -> Path | None:
    """Where the newest PostgreSQL has its programs."""
    candidates: list[Path] = []
    if found := shutil.which("initdb"):
        candidates.append(Path(found).resolve().parent)
    if config := shutil.which("pg_config"):
        told = subprocess.run([config, "--bindir"], capture_output=True, text=True, check=False).stdout.strip()
        candidates.append(Path(told))
    installed = [path.parent for path in Path("/usr/lib/postgresql").glob("*/bin/initdb")]
    candidates += sorted(installed, key=lambda path: float(path.parent.name), reverse=True)
    # A client's package brings some of the programs alone.
    return next((c for c in candidates if (c / "initdb").exists() and (c / "pg_ctl").exists()), None)


def _unprivileged() -> pwd.struct_passwd:
    for name in ("postgres", "nobody"):
        with contextlib.suppress(KeyError):
            return pwd.getpwnam(name)
    pytest.skip("PostgreSQL does not run as root, and there is no user postgres or nobody")
