"""The security audit log: who logged in and who was refused, who stopped, released, allowed and changed what.

One line of JSON for each event, in `audit.jsonl` of the data folder, appended by all processes of the robot. A thread
writes, so nobody waits for the disk: a stop least of all. Somebody who repeats an event without end is counted and not
listed, so that a flood pushes nobody else's events out of the files. The log must never contain a token, a key or a
prompt, and an event that cannot be written must never keep anybody from stopping the robot.
"""

from __future__ import annotations

import contextlib
import fcntl
import logging
import math
import os
import pwd
import queue
import threading
import time
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

import orjson

from backend.identity import Identity
from backend.rates import TokenBucket
from backend.visible import visible

FILE = "audit.jsonl"
KEPT_FILES = 5
"""Older ones are removed: `audit.jsonl` and `audit.jsonl.1` to `audit.jsonl.4`."""
MAX_FILE_BYTES = 10 * 1024 * 1024
MAX_WAITING = 10_000
"""Events that may wait to be written. Further ones are counted, and the count is logged."""
MAX_TEXT_CHARS = 300
PER_MINUTE, AT_ONCE = 30, 300
"""Lines of one kind of event by one person, for long and for a moment. Of refused logins, of which nobody knows whose
they are, there are `PER_MINUTE` in all."""
MAX_PEOPLE = 1000
"""So many pairs of event and person are counted apart. Of more, the pair that was seen longest ago is forgotten."""
COUNT_EVERY_S = 60.0
"""How often the events beyond `PER_MINUTE` are written as numbers."""

Event = Literal[
    "login", "login_refused", "logout", "token_created", "token_revoked", "code_created",
    "key_rotated", "mode_changed", "permission", "stop", "release", "take_over", "session_deleted",
]  # fmt: skip

Details = dict[str, str | int | float | None]

log = logging.getLogger(__name__)


class Audit:
    """The audit log as one process writes it; `process` is its name: robot, agent, bridge or command."""

    def __init__(self, data_dir: Path, process: str, *, lists_all: bool = False) -> None:
        """With `lists_all` no event is left out: for a command, which ends by itself."""
        self._lists_all = lists_all
        self._path = data_dir / FILE
        self._process = process
        self._waiting: queue.Queue[bytes | None] = queue.Queue(MAX_WAITING)
        self._lost = 0
        self._repeated = _Repeated()
        self._failed = False
        self._writer: threading.Thread | None = None

    def record(self, event: Event, by: Identity | str | None = None, **details: str | int | float | None) -> None:
        """Add an event. `by` is the person, or a name where nobody is known. Returns at once and raises nothing."""
        try:
            entry = self._entry(event) | _person(by)
            if not (self._lists_all or self._repeated.admit((event, _who(event, by)), time.monotonic())):
                return
            entry |= {name: _text(value) if isinstance(value, str) else value for name, value in details.items()}
            if self._writer is None:
                writer = threading.Thread(target=self._write_all, name="audit", daemon=True)
                writer.start()
                self._writer = writer
            self._waiting.put_nowait(orjson.dumps(entry) + b"\n")
        except Exception:  # no room in the queue, no room for a thread: a stop must go on all the same
            self._lost += 1

    def close(self) -> None:
        """Write the events that wait, for 2 s at most."""
        if self._writer is not None:
            with contextlib.suppress(queue.Full):
                self._waiting.put(None, timeout=2.0)
            self._writer.join(2.0)
            self._writer = None

    def _entry(self, event: str) -> dict[str, object]:
        return {"time": round(time.time(), 3), "process": self._process, "event": event}

    def _write_all(self) -> None:
        ended = False
        counted_at = time.monotonic()
        while not ended:
            lines: list[bytes | None] = []
            with contextlib.suppress(queue.Empty):
                lines.append(self._waiting.get(timeout=COUNT_EVERY_S))
            while not self._waiting.empty():
                lines.append(self._waiting.get())
            ended = None in lines
            if ended or time.monotonic() - counted_at >= COUNT_EVERY_S:
                counted_at = time.monotonic()
                lines += [
                    orjson.dumps(self._entry(event) | {"by": who or None, "more": count}) + b"\n"
                    for (event, who), count in self._repeated.take_counts().items()
                ]
            if self._lost:
                lost, self._lost = self._lost, 0
                lines.append(orjson.dumps(self._entry("lost") | {"more": lost}) + b"\n")
            content = b"".join(line for line in lines if line is not None)
            if content:
                self._write(content)

    def _write(self, content: bytes) -> None:
        try:
            _append(self._path, content)
            self._failed = False
        except OSError as error:
            if not self._failed:
                log.error("the audit log %s cannot be written: %s", self._path, error.strerror)
            self._failed = True


class _Repeated:
    """How often each person caused each kind of event, and how many of them are not listed. `now` is in s."""

    def __init__(self) -> None:
        self._rates: OrderedDict[tuple[str, str], TokenBucket] = OrderedDict()
        self._counts: dict[tuple[str, str], int] = {}
        self._lock = threading.Lock()

    def admit(self, key: tuple[str, str], now: float) -> bool:
        """Whether this event is listed; otherwise it is counted."""
        with self._lock:
            rate = self._rates.pop(key, None) or TokenBucket(PER_MINUTE / 60, AT_ONCE if key[1] else PER_MINUTE)
            self._rates[key] = rate
            if len(self._rates) > MAX_PEOPLE:
                self._rates.popitem(last=False)
            if rate.take(now) == 0:
                return True
            if key not in self._counts and len(self._counts) >= MAX_PEOPLE:
                key = (key[0], "")
            self._counts[key] = self._counts.get(key, 0) + 1
            return False

    def take_counts(self) -> dict[tuple[str, str], int]:
        """The numbers since the last call, by event and person."""
        with self._lock:
            counts, self._counts = self._counts, {}
            return counts


def record_command(data_dir: Path, *events: tuple[Event, Details]) -> None:
    """Record what a command of this computer's user has done: each event with its details."""
    log_of_command = Audit(data_dir, "command", lists_all=True)
    uid = os.getuid()
    try:
        user = pwd.getpwuid(uid).pw_name
    except KeyError:
        user = f"user {uid}"
    for event, details in events:
        log_of_command.record(event, user, uid=uid, **details)
    log_of_command.close()


def entries(data_dir: Path, since: float = 0.0) -> Iterator[dict[str, object]]:
    """The events since this Unix time, in the order in which they were written: that of their times, but for seconds
    where several processes write. A line that cannot be read is left out. Raises `OSError`."""
    with ExitStack() as opened:
        # All of them while no process begins a new file, so that none is read twice and none is missed.
        files = []
        with _locked(data_dir, fcntl.LOCK_SH):
            for number in reversed(range(KEPT_FILES)):
                with contextlib.suppress(FileNotFoundError):
                    files.append(opened.enter_context(_numbered(data_dir / FILE, number).open("rb")))
        for file in files:
            for line in file:
                entry = _read(line)
                if entry is not None and entry["time"] >= since:
                    yield entry


def _read(line: bytes) -> dict[str, Any] | None:
    try:
        entry = orjson.loads(line)
    except orjson.JSONDecodeError:
        return None
    at = entry.get("time") if isinstance(entry, dict) else None
    return entry if isinstance(at, int | float) and math.isfinite(at) else None


def _person(by: Identity | str | None) -> dict[str, object]:
    if isinstance(by, Identity):
        return {"by": _text(by.name), "role": by.role.value, "token": by.token_id}
    return {} if by is None else {"by": _text(by)}


def _who(event: str, by: Identity | str | None) -> str:
    """Whose events of a kind are counted together, by a name for people."""
    if by is None or event == "login_refused":
        return ""
    return _text(by.name if isinstance(by, Identity) else by)


def _append(path: Path, content: bytes) -> None:
    """Append whole lines. The lock keeps the processes apart, above all while one begins a new file."""
    with _locked(path.parent, fcntl.LOCK_EX):
        try:
            if path.stat().st_size + len(content) > MAX_FILE_BYTES:
                _begin_new(path)
        except FileNotFoundError:
            pass
        file = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        try:
            while content:
                content = content[os.write(file, content) :]
            os.fsync(file)
        finally:
            os.close(file)


@contextlib.contextmanager
def _locked(folder: Path, kind: int) -> Iterator[None]:
    opened = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(opened, kind)
        yield
    finally:
        os.close(opened)


def _begin_new(path: Path) -> None:
    for number in reversed(range(1, KEPT_FILES)):
        older = _numbered(path, number - 1)
        if older.exists():
            older.replace(_numbered(path, number))


def _numbered(path: Path, number: int) -> Path:
    return path.with_name(f"{path.name}.{number}") if number else path


def _text(value: str) -> str:
    return visible(value[:MAX_TEXT_CHARS])
