"""The findings of `robot-acp doctor`: one line each, and advice where something is missing."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One checked item: `what` was found, and what to do (`advice`) where `ok` is false, or where it is a warning."""

    name: str
    ok: bool
    what: str
    advice: str = ""
    warns: bool = False

    def __str__(self) -> str:
        state = "warning" if self.warns else "ok     " if self.ok else "missing"
        line = f"{state}  {self.name}: {self.what}"
        return line if not self.advice else f"{line}\n         → {self.advice}"


def good(name: str, what: str, _advice: str = "") -> Finding:
    """A finding about something that works."""
    return Finding(name, True, what)


def bad(name: str, what: str, advice: str) -> Finding:
    """A finding about something that is missing or does not work."""
    return Finding(name, False, what, advice)


def warning(name: str, what: str, advice: str) -> Finding:
    """A finding about something that works, and that people should know."""
    return Finding(name, True, what, advice, warns=True)
