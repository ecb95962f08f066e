"""What an examination finds: one line each, good or bad, and what to do about the bad ones."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """`advice` is what to do where `ok` is false."""

    name: str
    ok: bool
    what: str
    advice: str = ""

    def __str__(self) -> str:
        line = f"{'ok     ' if self.ok else 'missing'}  {self.name}: {self.what}"
        return line if self.ok or not self.advice else f"{line}\n         → {self.advice}"


def good(name: str, what: str, _advice: str = "") -> Finding:
    """Something works."""
    return Finding(name, True, what)


def bad(name: str, what: str, advice: str) -> Finding:
    """Something does not."""
    return Finding(name, False, what, advice)
