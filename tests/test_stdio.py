"""stdin and stdout as streams: pipes, files, a terminal that is both at once, and nothing at all."""

from __future__ import annotations

import asyncio
import os
import pty
import select
import subprocess
import sys
import tty
from pathlib import Path

import pytest

from backend.stdio import stdin
from tests.processes import PATIENCE_S, eventually

COPY = """
import asyncio
from backend.stdio import stdin, stdout

async def copy():
    async with stdin() as reader, stdout() as writer:
        async for line in reader:
            writer.write(line)
            await writer.drain()

asyncio.run(copy())
"""
LINES = b"".join(b"line %d %s\n" % (number, b"x" * 1000) for number in range(1000)) + b"the last, without its newline"


@pytest.mark.parametrize("source", ["pipe", "file"])
@pytest.mark.parametrize("sink", ["pipe", "file"])
def test_every_byte_arrives_from_pipes_and_files(tmp_path: Path, source: str, sink: str) -> None:
    given, copied = tmp_path / "given", tmp_path / "copied"
    given.write_bytes(LINES)
    with given.open("rb") as from_file, copied.open("wb") as to_file:
        done = subprocess.run(
            [sys.executable, "-c", COPY],
            timeout=PATIENCE_S,
            check=True,
            stdout=subprocess.PIPE if sink == "pipe" else to_file,
            **({"input": LINES} if source == "pipe" else {"stdin": from_file}),
        )
    assert (done.stdout if sink == "pipe" else copied.read_bytes()) == LINES


def test_a_terminal_can_be_both() -> None:
    ours, theirs = pty.openpty()
    tty.setraw(theirs)  # no echo
    with subprocess.Popen([sys.executable, "-c", COPY], stdin=theirs, stdout=theirs) as process:
        os.close(theirs)
        for word in (b"one\n", b"two\n"):  # the second is read after stdout, and so the terminal, became non-blocking
            os.write(ours, word)
            assert select.select([ours], [], [], PATIENCE_S)[0], "nothing was copied"
            assert os.read(ours, 100) == word
        os.close(ours)
        assert process.wait(PATIENCE_S) == 0


def test_there_may_be_no_input() -> None:
    command = [sys.executable, "-c", COPY]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=PATIENCE_S, check=True)
    assert (done.stdout, done.stderr) == (b"", b"")


async def test_a_stream_that_is_not_read_stops_the_reading() -> None:
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    written = 0

    def write() -> bool:
        """Write as much as the pipe takes; whether it has been full for a while."""
        nonlocal written, full
        try:
            written += os.write(writing, b"x" * 4095 + b"\n")
            full = 0
        except BlockingIOError:
            full += 1
        return full > 20

    full = 0
    async with asyncio.timeout(PATIENCE_S), stdin(10_000, reading) as reader:
        await eventually(write, "the pipe to stay full")
        assert written < 1_000_000
        os.close(writing)
        assert len(await reader.read()) == written
    os.close(reading)
