"""A short run over every parser of a stranger's bytes; a deep run takes longer, with inputs of its own."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.deep import DEEP, seed
from tests.fuzz.engine import Parser, fuzz
from tests.fuzz.parsers import PARSERS

INPUTS = 30_000 if DEEP else 400


@pytest.mark.parametrize("parser", PARSERS, ids=lambda parser: parser.name)
def test_no_bytes_of_a_stranger_break_a_parser(parser: Parser) -> None:
    findings = fuzz(parser, seed(7), inputs=INPUTS)
    assert findings.failures == []
    assert findings.inputs == INPUTS


FOUND = {
    "lines of a stream (bridge)": [b"\x01" + b"a" * 2_000 + b"\nb"],
    "MCP servers that a client offers": [
        b'{"cwd":"/","mcpServers":[{"type":"http","name":"a","headers":[],"url":"' + b"a" * 100_000 + b'"}]}'
    ],
    "addresses of MCP servers": [b"a" * 200_000],
    "the map of a tool (offline model)": [b'{"nodes": 1}', b"[" * 100_000],
    "telemetry of a robot server": [b"\x84\xa4type\xa4\xbe\xcfp\xc0", b"\x81\xa4type" + b"\x91" * 20_000],
    "subscriptions to telemetry": [b"\x81\xa4type\xa4\xbe\xcfp\xc0"],
    "messages of a scene's page": [b"\x81\xa4type\xa1\x80", b"\x81\xa1a" + b"\x91" * 4_000],
    "requests to a scene": [b'{"view":"\x80"}', b'{"a":' + b"[" * 2_000],
    "updates in the terminal": [
        b'{"jsonrpc":"2.0","method":"a","params":{"sessionUpdate":"plan","entries":[{"content":{},"status":"pending"}]}}',
        b'{"jsonrpc":"2.0","method":"a","params":{"sessionUpdate":"tool_call_update","status":"odd"}}',
    ],
    "the name of who stops": [b'{"x":' + b"[" * 4_000],
    "telemetry in the terminal": [b'{"online":true,"battery":{"level":1e999,"charging":false,"floor":0}}'],
}
"""Inputs that once broke a parser."""


@pytest.mark.parametrize(("name", "data"), [(name, data) for name, inputs in FOUND.items() for data in inputs])
def test_what_was_found_stays_mended(name: str, data: bytes) -> None:
    (parser,) = [parser for parser in PARSERS if parser.name == name]
    assert fuzz(replace(parser, seeds=[data]), 1, inputs=1).failures == []


def test_the_fuzzer_finds_what_is_there() -> None:
    def parse(data: bytes) -> None:
        if b"\xff" in data:
            raise KeyError("found")

    failures = fuzz(Parser("a parser with a fault", parse, (b"abc",)), 1, inputs=500).failures
    assert {what for _, what in failures} == {"KeyError: 'found'"}
