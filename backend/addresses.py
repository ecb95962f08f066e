"""Addresses of the network: a URL from host and port, and where a server that listens on all addresses is reached.

Every URL of a host and a port is put together here: an IPv6 address needs brackets in a URL and nowhere else.
"""

from __future__ import annotations

import socket
from ipaddress import ip_address

_ANY = {"": "127.0.0.1", "0.0.0.0": "127.0.0.1", "::": "::1"}  # noqa: S104 - compared, not bound
"""Where a server that listens on all addresses of its machine is reached on that machine."""


def authority(host: str, port: int) -> str:
    """Host and port as a URL has them, and as people read them: `127.0.0.1:80`, `[::1]:80`."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def url(scheme: str, host: str, port: int, path: str = "") -> str:
    """The URL of a path, which begins with a slash, at host and port."""
    return f"{scheme}://{authority(host, port)}{path}"


def reached_at(host: str) -> str:
    """The host to connect to, on the same machine, for a server that listens on `host`."""
    return _ANY.get(host, host)


def family(host: str) -> socket.AddressFamily:
    """The family of the socket that listens on `host`, an address or a name. Raises `OSError` for an unknown name."""
    try:
        return socket.AF_INET6 if ip_address(host.partition("%")[0]).version == 6 else socket.AF_INET
    except ValueError:
        return socket.getaddrinfo(host, None, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0][0]


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches a server that listens on `host`."""
    try:
        return ip_address(host.partition("%")[0]).is_loopback
    except ValueError:
        return host.lower() == "localhost"
