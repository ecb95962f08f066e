"""Makes the invisible characters of other people's texts visible, so that people approve the text that they read.

A control character can change a line of a terminal that is printed already. A format character can turn a sentence
round, or make two different names look alike. Every text of somebody else passes here before people read it in a
terminal, in a question, in a title or in a log. Nothing here may change a text that is stored, spoken or sent on.
"""

from __future__ import annotations

import unicodedata

_MARKED = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
"""Unicode's general categories: control, format, surrogate, line separator, paragraph separator."""
_BLANK = frozenset("\u034f\u115f\u1160\u17b4\u17b5\u3164\uffa0")
"""Letters and marks that nobody sees, and that are in none of these categories."""
_SEEN = frozenset("\u0600\u0601\u0602\u0603\u0604\u0605\u06dd\u070f\u0890\u0891\u08e2\U000110bd\U000110cd")
"""Format characters that everybody sees: signs around numbers."""
_JOINERS = "\u200c\u200d"


def visible(text: str, *, lines: bool = False) -> str:
    """The text with a mark in place of each character that nobody sees: `‹U+202E›` for an override of the writing
    direction, `↵` for a line break.

    The result is one line; with `lines`, line feeds and tabs stay. Joiners stay inside emoji and other scripts.
    web/src/wire/visible-text.ts makes the same marks.
    """
    if text.isprintable() and _BLANK.isdisjoint(text):
        return text
    text = text.replace("\r\n", "\n")
    return "".join(_mark(text, index, lines) if _is_unseen(char) else char for index, char in enumerate(text))


def _is_unseen(char: str) -> bool:
    return (unicodedata.category(char) in _MARKED and char not in _SEEN) or char in _BLANK


def _mark(text: str, index: int, lines: bool) -> str:
    char = text[index]
    if char in "\n\t":
        return char if lines else "↵" if char == "\n" else " "
    if char in _JOINERS:
        before, after = text[index - 1 : index], text[index + 1 : index + 2]
        if before and after and not (before + after).isascii() and before not in _JOINERS:
            return char
    return f"‹U+{ord(char):04X}›"
