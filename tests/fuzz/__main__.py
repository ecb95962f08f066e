"""Fuzzes every parser of a stranger's bytes for a while and prints a table.

    python -m tests.fuzz [--seconds 30] [--seed N] [--only WORD]

The exit status is 1 when something was found; each finding is printed with the input that shows it.
"""

from __future__ import annotations

import argparse
import random
import sys

from tests.fuzz.engine import Findings, fuzz
from tests.fuzz.parsers import PARSERS


def row(findings: Findings) -> str:
    """One line of the table."""
    found = "; ".join(sorted({what.partition(":")[0] for _, what in findings.failures})) or "nothing"
    return f"| {findings.parser.name} | {findings.inputs:,} | {findings.refused:,} | {findings.lines} | {found} |"


def main() -> int:
    """Read the arguments and fuzz."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=30.0, help="for each parser (default: 30)")
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(2**32))
    parser.add_argument("--only", default="", help="only parsers whose name contains this")
    asked = parser.parse_args()
    print(f"seed {asked.seed}\n\n| parser | inputs | refused | lines reached | found |\n|---|---:|---:|---:|---|")
    failed: list[Findings] = []
    for one in PARSERS:
        if asked.only in one.name:
            findings = fuzz(one, asked.seed, seconds=asked.seconds)
            print(row(findings), flush=True)
            if findings.failures:
                failed.append(findings)
    for findings in failed:
        shortest: dict[str, tuple[bytes, str]] = {}
        for data, what in sorted(findings.failures, key=lambda failure: len(failure[0])):
            shortest.setdefault(what.partition(":")[0], (data, what))
        for data, what in shortest.values():
            print(f"\n{findings.parser.name}: {what}\n  {data[:300]!r}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
