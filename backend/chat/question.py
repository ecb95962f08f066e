"""A permission question as the terminal asks it: the options that were offered, and the key that selects each.

No terminal, no socket. A key stands for a kind of option, never for an id: each agent has its own ids. What was not
offered has no key.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from backend import meta as keys
from backend.visible import visible

_KEYS = {"allow_once": "y", "reject_once": "n", "allow_always": "a", "reject_always": "v"}
_WORDS = {"yes": "y", "no": "n"}


@dataclass(frozen=True)
class Question:
    """A question that waits for an answer."""

    title: str
    """What the robot would do."""
    seconds: float | None
    """The time to answer; None where the agent gives none."""
    options: dict[str, tuple[str, str]]
    """Key -> the id and the name of the option."""

    @classmethod
    def of(cls, params: dict[str, Any]) -> Question:
        """From the parameters of `session/request_permission`. Options without an id are left out."""
        seconds = _dict(params.get("_meta")).get(keys.TIMEOUT_S)
        title = _dict(params.get("toolCall")).get("title")
        offered = params.get("options")
        options: dict[str, tuple[str, str]] = {}
        for option in map(_dict, offered if isinstance(offered, list) else ()):
            kind, option_id = str(option.get("kind")), option.get("optionId")
            if isinstance(option_id, str):
                key = _KEYS.get(kind, "")
                if not key or key in options:  # a second one of its kind, or one of a kind that is not known
                    key = str(sum(known.isdigit() for known in options) + 1)
                options[key] = option_id, _line(option.get("name") or option_id)
        limit = float(seconds) if isinstance(seconds, int | float) else None
        return cls(_line(title or "act"), limit, options)

    def text(self, robot: str) -> str:
        """The question and its options, for people."""
        limit = f" ({self.seconds:.0f} s to answer)" if self.seconds else ""
        choices = " · ".join(f"{key} {name}" for key, (_, name) in self.options.items())
        return f"{robot} asks: {self.title}{limit}\n  {choices}"

    @property
    def choices(self) -> str:
        """The keys, for people."""
        *others, last = self.options
        return f"{', '.join(others)} or {last}" if others else last

    def selected(self, line: str) -> str | None:
        """The id of the option that a line selects; None where it selects none of those offered."""
        word = line.strip().lower()
        option = self.options.get(_WORDS.get(word, word))
        return option[0] if option else None


def _dict(value: object) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _line(text: object) -> str:
    """A text of the agent as one line: with a line of its own it could pretend to be another question."""
    return visible(" ".join(str(text).split()))
