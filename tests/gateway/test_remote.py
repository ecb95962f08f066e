"""Where the remote is: what an address means, and what becomes of the token."""

from __future__ import annotations

import pytest

from backend import config
from backend.gateway.remote import Address, RemoteError


@pytest.mark.parametrize(
    ("given", "meant", "port"),
    [
        ("wss://robot.example.org", "wss://robot.example.org/acp", 443),
        ("ws://[::1]:8080", "ws://[::1]:8080/acp", 8080),
        ("wss://example.org/robots/1/acp", "wss://example.org/robots/1/acp", 443),
        ("ws://example.org/", "ws://example.org/", 80),
        ("tcp://[::1]:9100", "tcp://[::1]:9100", 9100),
    ],
)
def test_an_address_is_completed_where_only_one_thing_can_be_meant(given: str, meant: str, port: int) -> None:
    address = Address.parse(given, None)
    assert (address.url, address.port) == (meant, port)


@pytest.mark.parametrize(
    ("host", "url"),
    [
        ("127.0.0.1", "ws://127.0.0.1:8081/acp"),
        ("0.0.0.0", "ws://127.0.0.1:8081/acp"),  # noqa: S104
        ("::", "ws://[::1]:8081/acp"),
        ("robot.local", "ws://robot.local:8081/acp"),
    ],
)
def test_the_local_bridge_is_found_wherever_it_is_bound(
    monkeypatch: pytest.MonkeyPatch, tmp_path: object, host: str, url: str
) -> None:
    monkeypatch.setenv("ROBOT_ACP_DATA_DIR", str(tmp_path))
    settings = config.load(bridge={"host": host, "port": 8081})
    assert Address.of_local_bridge(settings, None).url == url


def test_the_token_is_shown_nowhere() -> None:
    assert "SECRET" not in repr(Address.parse("wss://robot.example.org/acp", "SECRET"))


async def test_a_token_without_encryption_is_warned_of(caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(RemoteError, match="Is the address right"):
        await Address.parse("ws://robot.invalid/acp", "SECRET").connect()
    [warning] = caplog.messages
    assert "without encryption" in warning
    assert "SECRET" not in warning
