"""A small fuzzer: it changes valid inputs at random and keeps those that reach lines which none has reached before.

An input has found something when the parser raises an exception that it does not announce, or takes longer than
`SLOW_S` of CPU time. Plain Python: coverage is what `sys.settrace` reports for files of `backend/`.
"""

from __future__ import annotations

import random
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

BACKEND = str(Path(__file__).parents[2] / "backend")
SLOW_S = 2.0
"""Seconds of CPU time for one input, while every line is traced: a parser takes milliseconds."""
MAX_BYTES = 200_000
TOKENS = (
    b"\x00", b"\xff", b"\xf0\x9f\xa4\x96", b"\xe2\x80\xae", b"[", b"{", b"]", b"}", b'"', b":", b",", b"\n", b"\r\n",
    b" ", b"-", b"1e999", b"9" * 40, b"-0", b"NaN", b"null", b"true", b"0x10", b"\\u0000", b"\\ud800", b"../", b"%2e",
    b"&a", b"*a", b"<<: ", b"!!python/object:os.system", b"::1", b"[::1]", b"@", b";", b"=", b"?", b"#",
    b"[" * 2_000, b"a" * 5_000,
)  # fmt: skip


@dataclass(frozen=True)
class Parser:
    """One parser of a stranger's bytes: valid inputs to begin with, and the exceptions that it announces."""

    name: str
    parse: Callable[[bytes], object]
    seeds: Sequence[bytes]
    announced: tuple[type[BaseException], ...] = ()


@dataclass
class Findings:
    """What a run over one parser found."""

    parser: Parser
    inputs: int = 0
    lines: int = 0
    refused: int = 0
    failures: list[tuple[bytes, str]] = field(default_factory=list)


class _Lines:
    """The lines of `backend/` that one call reaches."""

    def __init__(self) -> None:
        self.seen: set[tuple[str, int]] = set()

    def __call__(self, frame: FrameType, _event: str, _argument: object) -> Any:
        return self._line if frame.f_code.co_filename.startswith(BACKEND) else None

    def _line(self, frame: FrameType, event: str, _argument: object) -> Any:
        if event == "line":
            self.seen.add((frame.f_code.co_filename, frame.f_lineno))
        return self._line


def changed(dice: random.Random, corpus: Sequence[bytes]) -> bytes:
    """One input of the corpus after one to four random changes."""
    data = bytearray(dice.choice(corpus))
    for _ in range(dice.randint(1, 4)):
        at, end = sorted((dice.randint(0, len(data)), dice.randint(0, len(data))))
        match dice.randrange(7):
            case 0:
                data[at:at] = dice.choice(TOKENS)
            case 1:
                data[at : at + 1] = bytes([dice.randrange(256)])
            case 2:
                del data[at : min(end, at + 50)]
            case 3:
                data[at:at] = data[at : min(end, at + 200)] * dice.choice((1, 2, 200))
            case 4:
                other = dice.choice(corpus)
                data[at:end] = other[dice.randint(0, len(other)) :][:500]
            case 5:
                data[at:end] = dice.choice(TOKENS)
            case _:
                data[at:at] = dice.randbytes(dice.randint(1, 20))
    return bytes(data[:MAX_BYTES])


def fuzz(parser: Parser, seed: int, *, seconds: float | None = None, inputs: int | None = None) -> Findings:
    """Feed a parser for so many seconds, or with so many inputs. The same seed and number give the same inputs."""
    dice = random.Random(f"{parser.name} {seed}")  # noqa: S311 - repeatable on purpose
    corpus, reached = list(parser.seeds), set[tuple[str, int]]()
    findings = Findings(parser)
    deadline = time.monotonic() + (seconds if seconds is not None else 1e9)
    while time.monotonic() < deadline and (inputs is None or findings.inputs < inputs):
        first = findings.inputs < len(parser.seeds)
        data = parser.seeds[findings.inputs] if first else changed(dice, corpus)
        findings.inputs += 1
        lines = _try(parser, data, findings)
        if not lines <= reached:
            reached |= lines
            corpus.append(data)
    findings.lines = len(reached)
    return findings


def _try(parser: Parser, data: bytes, findings: Findings) -> set[tuple[str, int]]:
    lines, before, tracing = _Lines(), time.process_time(), sys.gettrace()
    sys.settrace(lines)
    try:
        parser.parse(data)
    except parser.announced:
        findings.refused += 1
    except Exception as error:  # every other one is a finding, whatever it is
        findings.failures.append((data, f"{type(error).__name__}: {error}"[:200]))
    finally:
        sys.settrace(tracing)
    if time.process_time() - before > SLOW_S:
        findings.failures.append((data, f"took {time.process_time() - before:.1f} s"))
    return lines.seen
