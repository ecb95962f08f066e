"""Other people's texts in front of people: nothing invisible stays invisible, and ordinary text stays as it is."""

from __future__ import annotations

import sys
import unicodedata

import pytest

from backend.visible import _SEEN, visible


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ("Drive to \u202enehctik eht", "Drive to ‹U+202E›nehctik eht"),
        ("Speak\nAllowed by Ana.", "Speak↵Allowed by Ana."),
        ("\x1b]0;mine\x07\x1b[2J", "‹U+001B›]0;mine‹U+0007›‹U+001B›[2J"),
        ("desk\u200b", "desk‹U+200B›"),
        ("des\u200dk", "des‹U+200D›k"),
        ("\x7f\x9b2J", "‹U+007F›‹U+009B›2J"),
        ("a\u3164b", "a‹U+3164›b"),
        ("a\u2028b\u2029c\u00ad", "a‹U+2028›b‹U+2029›c‹U+00AD›"),
        ("\ud800", "‹U+D800›"),
        ("\u200d\u200d家\u200d\u200d\u200d家", "‹U+200D›‹U+200D›家\u200d‹U+200D›‹U+200D›家"),
    ],
)
def test_each_control_and_format_character_is_a_mark(text: str, read: str) -> None:
    assert visible(text) == read


@pytest.mark.parametrize(
    "text",
    [
        "",
        "Go to the kitchen – “now”.",
        "¿Dónde está la cocina?",
        "研究室へ行って",
        "👩\u200d🔬 and 🏳️\u200d🌈",
        "می\u200cخواهم",
        "لبنى",
    ],
)
def test_ordinary_text_stays_as_it_is(text: str) -> None:
    assert visible(text) == text


def test_line_feeds_and_tabs_stay_in_a_text_of_several_lines() -> None:
    assert visible("one\r\ntwo\tthree\x1b[A\rfour", lines=True) == "one\ntwo\tthree‹U+001B›[A‹U+000D›four"


def test_no_character_that_can_move_or_hide_text_passes() -> None:
    """All of Unicode, between letters and between symbols of other scripts."""
    for code in range(sys.maxunicode + 1):
        char = chr(code)
        if unicodedata.category(char) in ("Cc", "Cf", "Zl", "Zp") and char not in _SEEN:
            assert char not in visible(f"a{char}b"), f"U+{code:04X}"
            assert char not in visible(f"家{char}家") or char in "\u200c\u200d", f"U+{code:04X}"
