"""Newline-delimited frames out of a stream of bytes, without any I/O."""

from __future__ import annotations


class LineSplitter:
    """Gives the whole lines of a stream as its bytes come in, and holds back the unfinished last one.

    A line of more than `limit` bytes is cut at `limit + 1`, so that it costs no more memory than that and is
    still seen to be too long by whoever checks it.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._parts: list[bytes] = []  # of the unfinished line
        self._size = 0  # of these parts together

    def feed(self, data: bytes) -> list[bytes]:
        """The lines that `data` finishes, without their newlines; blank ones are left out."""
        first, *others = data.split(b"\n")
        if not others:
            self._hold(first)
            return []
        if self._parts:
            self._hold(first)
            first = b"".join(self._parts)
        self._parts, self._size = [], 0
        self._hold(others.pop())
        return [line for line in (first, *others) if line and not line.isspace()]

    def _hold(self, part: bytes) -> None:
        room = self._limit + 1 - self._size
        if part and room > 0:
            self._parts.append(part[:room])
            self._size += min(len(part), room)
