"""Splits a stream of bytes into newline-delimited frames, without any I/O."""

from __future__ import annotations


class LineSplitter:
    """Returns the whole lines of a stream as its bytes arrive, and keeps the unfinished last one.

    A line of more than `limit` bytes is cut to `limit + 1`: it takes no more memory than that, and is still too long
    for whoever checks its length.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._parts: list[bytes] = []  # of the unfinished line
        self._size = 0

    @property
    def kept_bytes(self) -> int:
        """How many bytes of the unfinished line are kept."""
        return self._size

    def feed(self, data: bytes) -> list[bytes]:
        """The lines that `data` completes, without their newlines and without blank lines."""
        first, *others = data.split(b"\n")
        if not others:
            self._keep(first)
            return []
        if self._parts:
            self._keep(first)
            first = b"".join(self._parts)
        self._parts, self._size = [], 0
        self._keep(others.pop())
        longest = self._limit + 1
        # A line that is too long may be blank as far as it is kept. It is no blank line: somebody may wait for it.
        return [line[:longest] for line in (first, *others) if len(line) > self._limit or (line and not line.isspace())]

    def _keep(self, part: bytes) -> None:
        room = self._limit + 1 - self._size
        if part and room > 0:
            self._parts.append(part[:room])
            self._size += min(len(part), room)
