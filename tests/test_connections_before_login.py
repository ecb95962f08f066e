"""Who makes room for whom among connections that have not logged in."""

from __future__ import annotations

import pytest

from backend.connections_before_login import ConnectionsBeforeLogin, Use, network_of


class Door:
    """Connections of a server, by number, and which of them were closed."""

    def __init__(self, total: int, per_address: int) -> None:
        self.limit = ConnectionsBeforeLogin(total, per_address)
        self.closed: list[int] = []

    def add(self, key: int, host: str = "127.0.0.1") -> None:
        self.limit.add(key, host, lambda: self.closed.append(key))


def test_the_oldest_makes_room() -> None:
    door = Door(3, 9)
    for key in range(5):
        door.add(key)
    assert door.closed == [0, 1]
    assert len(door.limit) == 3


def test_one_that_has_logged_in_is_not_counted() -> None:
    door = Door(2, 9)
    door.add(0)
    door.limit.remove(0)
    door.add(1)
    door.add(2)
    assert door.closed == []


def test_one_address_displaces_only_itself() -> None:
    door = Door(100, 2)
    for key, host in enumerate(["192.0.2.1", "192.0.2.2", "192.0.2.1", "192.0.2.1", "192.0.2.2"]):
        door.add(key, host)
    assert door.closed == [0]


@pytest.mark.parametrize("host", ["127.0.0.1", "127.9.9.9", "::1", "::ffff:127.0.0.1", None, "", "a socket"])
def test_loopback_has_no_limit_of_its_own(host: str | None) -> None:
    door = Door(100, 2)
    for key in range(50):
        door.limit.add(key, host, lambda: pytest.fail("it was closed"))
    assert network_of(host) == ""


def test_one_computer_with_many_ipv6_addresses_is_one_sender() -> None:
    assert network_of("2001:db8::1") == network_of("2001:db8::ffff:2%eth0")
    assert network_of("2001:db8::1") != network_of("2001:db8:0:1::1")
    assert network_of("::ffff:192.0.2.1") == network_of("192.0.2.1") == "192.0.2.1"


def test_one_that_is_being_answered_is_closed_after_those_that_wait_and_a_stop_last() -> None:
    door = Door(3, 9)
    for key in range(3):
        door.add(key)
    door.limit.set_use(0, Use.STOPPING)
    door.limit.set_use(1, Use.ANSWERING)
    for key in range(3, 6):
        door.add(key)
    assert door.closed == [2, 3, 4]
    door.limit.set_use(5, Use.STOPPING)
    door.add(6)
    assert door.closed == [2, 3, 4, 1]
    door.limit.set_use(6, Use.STOPPING)
    door.add(7)
    assert door.closed == [2, 3, 4, 1, 0]


def test_one_that_has_logged_in_is_closed_after_those_that_have_not() -> None:
    door = Door(2, 9)
    door.add(0)
    door.limit.set_use(0, Use.KNOWN)
    for key in range(1, 4):
        door.add(key)
    assert door.closed == [1, 2]
