"""`robot-acp audit`: prints the events of the security audit log, as lines of JSON or as CSV, the oldest first.

It only reads. The texts in the log are made visible when they are written, and a cell of CSV can be no formula. Imports
are made where they are needed, as in `cli`.
"""

from __future__ import annotations

import argparse
import csv
import heapq
import json
import os
import sys
import time
from collections.abc import Iterable, Iterator
from datetime import UTC, date, datetime
from typing import TYPE_CHECKING, Any

from backend.lifetimes import lifetime

if TYPE_CHECKING:
    from backend.config import Settings

COLUMNS = ("time", "process", "event", "by", "role", "token", "details")
"""Of CSV; `details` is everything else, as JSON."""
_OUT_OF_ORDER = 10_000
"""Processes write apart, so an event can stand so many events behind younger ones."""
_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""A spreadsheet takes a cell that begins so for a formula."""


def add_to(commands: Any) -> None:
    """Add `audit` to the commands of a parser."""
    audit = commands.add_parser("audit", help="who logged in, stopped, released, allowed and changed what, and when")
    audit.add_argument(
        "--since", type=_since, default=0.0, metavar="WHEN", help="the last 30m, 12h or 7d, or from a day: 2027-01-31"
    )
    audit.add_argument("--csv", action="store_true", help="print CSV; otherwise each event is a line of JSON")
    audit.set_defaults(run=_print)


def _since(text: str) -> float:
    """The Unix time that `7d` (so long ago) or a date (its first second, local time) means."""
    try:
        return datetime.combine(date.fromisoformat(text), datetime.min.time()).timestamp()
    except (ValueError, OverflowError):
        pass
    try:
        return time.time() - lifetime(text)
    except ValueError:
        sentence = f"{text!r} is neither a time such as 30m, 12h or 7d, nor a date such as 2027-01-31"
        raise argparse.ArgumentTypeError(sentence) from None


def _print(settings: Settings, options: argparse.Namespace) -> int:
    from backend import audit

    if not settings.data_dir.is_dir():
        return 0  # nothing has ever run here
    events = _in_order(audit.entries(settings.data_dir, options.since))
    try:
        if options.csv:
            _print_csv(events)
        else:
            for event in events:
                print(json.dumps(_readable(event), ensure_ascii=False))
        sys.stdout.flush()
    except BrokenPipeError:  # the reader has seen enough; Python would write once more at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _in_order(events: Iterable[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """The events by their times, as far as the log has them nearly so."""
    waiting: list[tuple[float, int, dict[str, Any]]] = []
    for number, event in enumerate(events):
        heapq.heappush(waiting, (event["time"], number, event))
        if len(waiting) > _OUT_OF_ORDER:
            yield heapq.heappop(waiting)[2]
    while waiting:
        yield heapq.heappop(waiting)[2]


def _readable(event: dict[str, Any]) -> dict[str, Any]:
    """The event with its time as ISO 8601 in UTC."""
    try:
        return event | {"time": datetime.fromtimestamp(event["time"], UTC).isoformat(timespec="milliseconds")}
    except (ValueError, OverflowError, OSError):
        return event  # somebody else has written this line


def _print_csv(events: Iterable[dict[str, Any]]) -> None:
    table = csv.writer(sys.stdout, lineterminator="\n")
    table.writerow(COLUMNS)
    for event in map(_readable, events):
        details = {name: value for name, value in event.items() if name not in COLUMNS}
        cells = [event.get(name) for name in COLUMNS[:-1]]
        table.writerow([_cell(cell) for cell in (*cells, json.dumps(details, ensure_ascii=False) if details else None)])


def _cell(value: object) -> str:
    text = "" if value is None else str(value)
    return f"'{text}" if text.startswith(_FORMULA) else text
