"""Lines out of a stream of bytes."""

from __future__ import annotations

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from backend.bridge.line_splitter import LineSplitter

calmly = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
"""A busy machine is no failure."""


def test_whole_lines_come_out_and_the_rest_is_held_back():
    lines = LineSplitter(100)
    assert lines.feed(b"one\ntw") == [b"one"]
    assert lines.feed(b"o") == []
    assert lines.feed(b"\nthree\n") == [b"two", b"three"]


def test_blank_lines_are_left_out():
    assert LineSplitter(100).feed(b"\n \n\r\na\n\t\n") == [b"a"]


def test_a_line_over_the_limit_is_cut_one_byte_above_it_however_it_comes():
    for size in (1, 3, 1000):
        lines = LineSplitter(10)
        stream = b"x" * 500 + b"\nshort\n"
        out = [line for i in range(0, len(stream), size) for line in lines.feed(stream[i : i + size])]
        assert out[1] == b"short"
        assert len(out[0]) > 10
        assert lines.kept_bytes == 0


def test_a_line_over_the_limit_whose_beginning_is_blank_is_no_blank_line_however_it_comes():
    stream = b" " * 500 + b"{}\nshort\n"
    for size in (1, 3, 1000):
        lines = LineSplitter(10)
        out = [line for i in range(0, len(stream), size) for line in lines.feed(stream[i : i + size])]
        assert out == [b" " * 11, b"short"]


def test_a_line_without_an_end_takes_no_more_memory_than_the_limit():
    lines = LineSplitter(1000)
    for _ in range(1000):
        assert lines.feed(b"y" * 1000) == []
    assert lines.kept_bytes == 1001


@calmly
@given(st.lists(st.binary(max_size=12)), st.integers(1, 7))
def test_how_the_stream_is_cut_into_pieces_changes_nothing(parts: list[bytes], size: int):
    stream = b"".join(part + b"\n" for part in parts)
    lines = LineSplitter(1000)
    out = [line for i in range(0, len(stream), size) for line in lines.feed(stream[i : i + size])]
    assert out == [line for line in stream.split(b"\n") if line and not line.isspace()]
