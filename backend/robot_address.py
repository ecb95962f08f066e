"""Which robot server is meant by an address: plain functions over URLs, used by the settings. Nothing connects here.

A wrong answer would send a stop to another robot, or this robot's secret to somebody else. So in doubt two addresses
are two servers.
"""

from __future__ import annotations

import contextlib
from ipaddress import ip_address
from urllib.parse import SplitResult, urlsplit, urlunsplit

_WEB = {"http": 80, "https": 443}
_LOOPBACK = {"localhost": {"127.0.0.1", "::1"}}
_ANY = {"0.0.0.0": {"127.0.0.1"}, "": {"127.0.0.1", "::1"}, "::": {"127.0.0.1", "::1"}}  # noqa: S104 - compared, not bound


def check(url: str) -> str:
    """The URL of an MCP server, unchanged. Raises `ValueError` for what is neither `http(s)://HOST…` nor
    `stdio:COMMAND`."""
    if url.startswith("stdio:") and url.removeprefix("stdio:").strip():
        return url
    if _web(url) is None:
        raise ValueError("give http://HOST:PORT/mcp, https://HOST/mcp or stdio:COMMAND")
    return url


def check_base(url: str) -> str:
    """The base URL of a robot server, unchanged. Raises `ValueError` for what is not `http(s)://HOST…`."""
    if _web(url) is None:
        raise ValueError("give http://HOST:PORT or https://HOST")
    return url


def base_of(mcp_url: str) -> str | None:
    """The URL below which the other paths of an MCP server lie: `http://h:1/mcp` has its `/stop` at `http://h:1/stop`.
    None for a command."""
    parts = _web(mcp_url)
    if parts is None:
        return None
    folder = parts.path.rstrip("/").rpartition("/")[0]
    return urlunsplit((parts.scheme, parts.netloc, folder, "", ""))


def same_server(url: str, other: str) -> bool:
    """Whether two URLs name the same host and port over the same scheme. A server that is bound to any address of this
    machine is also the one on its loopback."""
    one, two = _web(url), _web(other)
    if one is None or two is None or one.scheme != two.scheme:
        return False
    return _port(one) == _port(two) and bool(_hosts(one.hostname or "") & _hosts(two.hostname or ""))


def is_loopback(url: str) -> bool:
    """Whether a URL names a server on this machine."""
    host = (parts.hostname if (parts := _web(url)) else None) or ""
    with contextlib.suppress(ValueError):
        return ip_address(host).is_loopback
    return host == "localhost"


def without_login(url: str) -> str:
    """The URL as people and logs may see it: without a user, a password or a query; of a command only the program."""
    parts = _web(url)
    if parts is None:
        return url.split(" ")[0]
    return urlunsplit((parts.scheme, parts.netloc.rpartition("@")[2], parts.path, "", ""))


def _web(url: str) -> SplitResult | None:
    try:
        parts = urlsplit(url)
        usable = parts.scheme in _WEB and bool(parts.hostname) and parts.port != 0
    except ValueError:  # a port that is no number, a bracket that is not closed
        return None
    return parts if usable else None


def _port(parts: SplitResult) -> int:
    return parts.port or _WEB[parts.scheme]


def _hosts(host: str) -> set[str]:
    return _LOOPBACK.get(host) or {host} | _ANY.get(host, set())
