"""The security audit log: who logged in and who was refused, who stopped, released, allowed and changed what.

One line of JSON for each event, in `audit.jsonl` of the data folder, appended by all processes of the robot. A thread
writes, so nobody waits for the disk: a stop least of all. The log must never contain a token, a key or a prompt, and an
event that cannot be written must never keep anybody from stopping the robot.
"""

from __future__ import annotations

import contextlib
import fcntl
import logging
import os
import queue
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import orjson

from backend.identity import Identity
from backend.visible import visible

FILE = "audit.jsonl"
KEPT_FILES = 5
"""Older ones are removed: `audit.jsonl` and `audit.jsonl.1` to `audit.jsonl.4`."""
MAX_FILE_BYTES = 10 * 1024 * 1024
MAX_WAITING = 10_000
"""Events that may wait to be written. Further ones are counted, and the count is logged."""
MAX_TEXT_CHARS = 300

Event = Literal[
    "login", "login_refused", "logout", "token_created", "token_revoked", "key_rotated", "mode_changed", "permission",
    "stop", "release", "take_over", "session_deleted",
]  # fmt: skip

log = logging.getLogger(__name__)


class Audit:
    """The audit log as one process writes it; `process` is its name: robot, agent, bridge or command."""

    def __init__(self, data_dir: Path, process: str) -> None:
        self._path = data_dir / FILE
        self._process = process
        self._waiting: queue.Queue[bytes | None] = queue.Queue(MAX_WAITING)
        self._lost = 0
        self._failed = False
        self._writer: threading.Thread | None = None

    def record(self, event: Event, by: Identity | str | None = None, **details: str | int | float | None) -> None:
        """Add an event. `by` is the person, or a name where nobody is known. Returns at once and raises nothing."""
        entry: dict[str, object] = {"time": round(time.time(), 3), "process": self._process, "event": event}
        if isinstance(by, Identity):
            entry |= {"by": visible(by.name), "role": by.role.value, "token": by.token_id}
        elif by is not None:
            entry["by"] = _text(by)
        entry |= {name: _text(value) if isinstance(value, str) else value for name, value in details.items()}
        if self._writer is None:
            self._writer = threading.Thread(target=self._write_all, name="audit", daemon=True)
            self._writer.start()
        try:
            self._waiting.put_nowait(orjson.dumps(entry) + b"\n")
        except queue.Full:
            self._lost += 1

    def close(self) -> None:
        """Write the events that wait, for 2 s at most."""
        if self._writer is not None:
            with contextlib.suppress(queue.Full):
                self._waiting.put(None, timeout=2.0)
            self._writer.join(2.0)
            self._writer = None

    def _write_all(self) -> None:
        ended = False
        while not ended:
            lines = [self._waiting.get()]
            while not self._waiting.empty():
                lines.append(self._waiting.get())
            ended = None in lines
            if self._lost:
                lost, self._lost = self._lost, 0
                lines.append(orjson.dumps({"time": time.time(), "process": self._process, "lost": lost}) + b"\n")
            try:
                _append(self._path, b"".join(line for line in lines if line is not None))
                self._failed = False
            except OSError as error:
                if not self._failed:
                    log.error("the audit log %s cannot be written: %s", self._path, error.strerror)
                self._failed = True


def entries(data_dir: Path, since: float = 0.0) -> Iterator[dict[str, object]]:
    """The events since this Unix time, the oldest first. A line that cannot be read is left out."""
    for number in reversed(range(KEPT_FILES)):
        try:
            content = _numbered(data_dir / FILE, number).read_bytes()
        except FileNotFoundError:
            continue
        for line in content.splitlines():
            try:
                entry = orjson.loads(line)
            except orjson.JSONDecodeError:
                continue
            if isinstance(entry, dict) and float(entry.get("time") or 0) >= since:
                yield entry


def _append(path: Path, content: bytes) -> None:
    """Append whole lines. The lock keeps the processes apart, above all while one begins a new file."""
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
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
    finally:
        os.close(folder)


def _begin_new(path: Path) -> None:
    for number in reversed(range(1, KEPT_FILES)):
        older = _numbered(path, number - 1)
        if older.exists():
            older.replace(_numbered(path, number))


def _numbered(path: Path, number: int) -> Path:
    return path.with_name(f"{path.name}.{number}") if number else path


def _text(value: str) -> str:
    return visible(value[:MAX_TEXT_CHARS])
