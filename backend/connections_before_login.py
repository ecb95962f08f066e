"""How many connections a server keeps whose sender it does not know yet, in all and from one address.

A new connection always gets in: beyond the limit the one that has waited longest is closed. An honest client logs in
within moments, so it is never the oldest, and strangers only displace each other. Loopback has no limit of its own:
behind a reverse proxy everybody comes from there.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from enum import IntEnum
from ipaddress import IPv6Address, ip_address


class Use(IntEnum):
    """What a connection does at present. Of two, the one with the lower value is closed first."""

    WAITING = 0
    """No whole request has arrived."""
    KNOWN = 1
    """The same, but a request before came with a valid login."""
    ANSWERING = 2
    """A request is being answered."""
    STOPPING = 3
    """A request to stop the robot is being answered."""


@dataclass
class _Connection:
    address: str
    close: Callable[[], None]
    use: Use = Use.WAITING


class ConnectionsBeforeLogin:
    """Those of one server: at most `total`, and `per_address` from one address. The oldest comes first."""

    def __init__(self, total: int, per_address: int) -> None:
        self._total = total
        self._per_address = per_address
        self._open: dict[Hashable, _Connection] = {}

    def __len__(self) -> int:
        return len(self._open)

    def add(self, key: Hashable, host: str | None, close: Callable[[], None]) -> None:
        """A connection from `host` has been accepted. `close` must break it at once."""
        address = network_of(host)
        if address:
            same = [other for other, connection in self._open.items() if connection.address == address]
            if len(same) >= self._per_address:
                self._close_oldest(same)
        if len(self._open) >= self._total:
            self._close_oldest(list(self._open))
        self._open[key] = _Connection(address, close)

    def remove(self, key: Hashable) -> None:
        """The connection has logged in, or is closed; nothing happens where it is not known."""
        self._open.pop(key, None)

    def set_use(self, key: Hashable, use: Use) -> None:
        """What a connection does from now on; nothing happens where it is not known."""
        if (connection := self._open.get(key)) is not None:
            connection.use = use

    def _close_oldest(self, candidates: list[Hashable]) -> None:
        oldest = min(candidates, key=lambda key: self._open[key].use)  # of equal ones the first
        self._open.pop(oldest).close()


def network_of(host: str | None) -> str:
    """The address that counts as one sender: an IPv4 address, or the /64 of an IPv6 address, which one computer has.

    It is empty for loopback and for a host that is no address, such as that of a Unix socket.
    """
    try:
        address = ip_address((host or "").partition("%")[0])
    except ValueError:
        return ""
    if isinstance(address, IPv6Address):
        address = address.ipv4_mapped or address
    if address.is_loopback:
        return ""
    return address.exploded[:19] if isinstance(address, IPv6Address) else str(address)
