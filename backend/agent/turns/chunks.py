"""Puts the words of a stream together, so that neither the log nor a client gets an event for each of them."""

from __future__ import annotations

import time
from collections.abc import Callable

EVERY_S = 0.04


class Chunks:
    """Hands the text on in pieces, at most one every `EVERY_S` seconds, and what is left with `flush`."""

    def __init__(self, show: Callable[[str], None]) -> None:
        self._show = show
        self._text = ""
        self._last = time.monotonic()

    def add(self, text: str) -> None:
        """Take in words; show what has come together when it is time."""
        self._text += text
        if time.monotonic() - self._last >= EVERY_S:
            self.flush()

    def flush(self) -> None:
        """Show what is left."""
        if self._text:
            self._show(self._text)
            self._text = ""
            self._last = time.monotonic()
