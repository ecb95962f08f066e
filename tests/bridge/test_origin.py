"""Which Host and Origin headers are ours."""

from __future__ import annotations

import socket

import pytest
from starlette.requests import HTTPConnection

from backend.bridge.origin import OriginError, OriginPolicy

POLICY = OriginPolicy("127.0.0.1", ["https://robot.example.org", "http://dev.local:5173/"])


def request(origin: str | None, host: str = "127.0.0.1:8080", scheme: str = "http") -> HTTPConnection:
    headers = [(b"host", host.encode())] + ([(b"origin", origin.encode())] if origin is not None else [])
    return HTTPConnection({"type": "http", "scheme": scheme, "headers": headers})


@pytest.mark.parametrize(
    "host",
    [
        "127.0.0.1",
        "127.0.0.1:8080",
        "localhost:8080",
        "LOCALHOST",
        "bridge.localhost:1",
        "[::1]:8080",
        "192.168.1.20:8080",
        "robot.example.org",
        "dev.local:5173",
        socket.gethostname(),
    ],
)
def test_an_address_or_a_known_name_is_ours(host):
    assert POLICY.knows_host(host)


@pytest.mark.parametrize(
    "host",
    [
        None,
        "",
        "evil.example",
        "evil.example:8080",
        "127.0.0.1.evil.example",
        "localhost.evil.example",
        "robot.example.org.evil.example",
        "xlocalhost",
        "[::1",
        "user@evil.example",
        ":8080",
    ],
)
def test_any_other_name_may_have_been_rebound_and_is_not(host):
    assert not POLICY.knows_host(host)


@pytest.mark.parametrize(
    ("origin", "host", "scheme"),
    [
        ("http://127.0.0.1:8080", "127.0.0.1:8080", "http"),
        ("http://127.0.0.1:8080", "127.0.0.1:8080", "ws"),
        ("http://localhost", "localhost:80", "http"),
        ("HTTP://LocalHost:8080", "localhost:8080", "http"),
        ("https://localhost", "localhost", "wss"),
        ("https://robot.example.org", "127.0.0.1:8080", "http"),
        ("https://robot.example.org:443", "127.0.0.1:8080", "http"),
        ("http://dev.local:5173", "127.0.0.1:8080", "ws"),
    ],
)
def test_our_own_origin_and_the_allowed_ones_may_speak(origin, host, scheme):
    POLICY.check(request(origin, host, scheme), explicit_token=False)


@pytest.mark.parametrize(
    "origin",
    [
        "null",
        "",
        "http://evil.example",
        "http://127.0.0.1",
        "http://127.0.0.1:8081",
        "https://127.0.0.1:8080",
        "http://localhost:8080",
        "http://127.0.0.1:8080.evil.example",
        "http://127.0.0.1:8080@evil.example",
        "http://127.0.0.1:99999",
        "file://",
        "chrome-extension://abcdef",
        "http://robot.example.org",
        "robot.example.org",
    ],
)
def test_every_other_origin_may_not_whatever_token_comes_with_it(origin):
    for explicit in (False, True):
        with pytest.raises(OriginError):
            POLICY.check(request(origin), explicit_token=explicit)


def test_no_origin_at_all_is_believed_only_with_a_token_that_no_browser_adds():
    POLICY.check(request(None), explicit_token=True)
    with pytest.raises(OriginError):
        POLICY.check(request(None), explicit_token=False)
