"""Makes the invisible characters of other people's texts visible, so that people approve the text that they read.

A control character can change a line of a terminal that is printed already. A format character can turn a sentence
round, or make two different names look alike. Every text of somebody else passes here before people read it in a
terminal, in a question, in a title or in a log. Nothing here may change a text that is stored, spoken or sent on.
"""

from __future__ import annotations

import unicodedata

_MARKED = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
"""Unicode's general categories: control, format, surrogate, line separator, paragraph separator."""
_JOINERS = "\u200c\u200d"


def visible(text: str, *, lines: bool = False) -> str:
    """The text with a mark in place of each control and format character: `␛` for an escape, `⟨U+202E⟩` for an override
    of the writing direction.

    The result is one line; with `lines`, line feeds and tabs stay. Joiners stay inside emoji and other scripts.
    """
    if text.isprintable():
        return text
    if lines:
        text = text.replace("\r\n", "\n")
    return "".join(
        _mark(char) if unicodedata.category(char) in _MARKED and not _stays(text, index, lines) else char
        for index, char in enumerate(text)
    )


def _stays(text: str, index: int, lines: bool) -> bool:
    char = text[index]
    if char in _JOINERS:
        before, after = text[index - 1 : index], text[index + 1 : index + 2]
        return bool(before and after) and not (before + after).isascii() and before not in _JOINERS
    return lines and char in "\n\t"


def _mark(char: str) -> str:
    code = ord(char)
    if code < 0x20:
        return chr(0x2400 + code)  # Unicode's control pictures have the same order
    return "␡" if code == 0x7F else f"⟨U+{code:04X}⟩"
