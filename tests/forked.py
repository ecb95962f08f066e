"""`robot-acp` commands in processes that are forked from one which has imported everything.

A new Python needs one to two CPU seconds until a server of ours listens; such a fork needs some hundredths. It has an
environment, a working directory, standard streams, signals and an exit status of its own, as any process has. What a
test shows about starting itself (`up`, stdio, restarts) belongs to the real command line: `Robot.command`.
"""

from __future__ import annotations

import atexit
import multiprocessing
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import forkserver
from multiprocessing.reduction import DupFd
from typing import IO, Any

_reader = ThreadPoolExecutor(thread_name_prefix="reader of a process")
_context = multiprocessing.get_context("forkserver")


class _Descriptor:
    """A file descriptor that the other process gets a duplicate of."""

    def __init__(self, number: int) -> None:
        self.number = number

    def __getstate__(self) -> Any:
        return DupFd(self.number)

    def __setstate__(self, duplicate: Any) -> None:
        self.number = duplicate.detach()


class Forked:
    """A command that runs, with the part of `subprocess.Popen` that tests use. Streams are text."""

    def __init__(
        self,
        arguments: Sequence[str],
        env: Mapping[str, str],
        stdin: int | None = None,
        stdout: int | IO[Any] | None = None,
        stderr: int | IO[Any] | None = None,
    ) -> None:
        _ensure_server()
        ours: list[IO[str] | None] = []
        theirs: list[int] = []
        opened: list[int] = []
        for number, wanted in enumerate((stdin, stdout, stderr)):
            mine: IO[str] | None = None
            if wanted == subprocess.PIPE:
                read, write = os.pipe()
                end, mine = (read, open(write, "w")) if number == 0 else (write, open(read))  # noqa: SIM115 - like Popen's
                opened.append(end)
            elif wanted == subprocess.STDOUT:
                end = theirs[1]
            elif wanted == subprocess.DEVNULL:
                end = os.open(os.devnull, os.O_RDWR)
                opened.append(end)
            else:
                end = number if wanted is None else wanted if isinstance(wanted, int) else wanted.fileno()
            theirs.append(end)
            ours.append(mine)
        self.stdin, self.stdout, self.stderr = ours
        self.args = list(arguments)
        streams = [_Descriptor(end) for end in theirs]
        self._process = _context.Process(target=_run, args=(self.args, dict(env), os.getcwd(), streams))
        self._process.start()
        for end in opened:
            os.close(end)
        assert self._process.pid is not None
        self.pid = self._process.pid

    @property
    def returncode(self) -> int | None:
        return self._process.exitcode

    def poll(self) -> int | None:
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
        return self._process.exitcode

    def communicate(self, timeout: float | None = None) -> tuple[str | None, str | None]:
        """Close its input and read its outputs to their ends, then wait for its own."""
        if self.stdin:
            self.stdin.close()
        outputs = [stream and _reader.submit(stream.read) for stream in (self.stdout, self.stderr)]
        self.wait(timeout)
        said, complained = (output and output.result(timeout) for output in outputs)
        return said, complained

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


def _ensure_server() -> None:
    """Start the process that is forked, once; `tests.preloaded` says what it has in memory."""
    _context.set_forkserver_preload(["tests.preloaded"])
    ours = {"OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    before = {name: os.environ.get(name) for name in ours}
    os.environ.update(ours)  # it has a single thread, and finds what this process finds
    try:
        forkserver.ensure_running()
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _leave_coverage_alone() -> None:
    """A coverage measurement of the process that was forked is not this one's to end; `coverage` itself begins and ends
    the one of a fork."""
    if coverage := sys.modules.get("coverage"):
        for measurement in coverage.Coverage._instances:
            atexit.unregister(measurement._atexit)


def _run(arguments: list[str], env: dict[str, str], folder: str, streams: list[_Descriptor]) -> None:
    """What a fork does: become `robot-acp` with these arguments."""
    for number, stream in enumerate(streams):
        os.dup2(stream.number, number)
        os.close(stream.number)
    sys.stdin = open(0, closefd=False)  # noqa: SIM115 - open as long as the process
    sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115
    sys.stderr = open(2, "w", buffering=1, errors="backslashreplace", closefd=False)  # noqa: SIM115
    for number in (signal.SIGTERM, signal.SIGCHLD):
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.environ.clear()
    os.environ.update(env)
    os.chdir(folder)
    sys.argv = ["robot-acp", *arguments]
    _leave_coverage_alone()
    from backend import cli

    try:
        status = cli.main(arguments)
    finally:
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
    sys.exit(status)
