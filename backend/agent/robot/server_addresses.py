"""The rule for the MCP servers that a client may bring into a session: plain functions over the client's request.

Nothing connects here. An address is taken only in the few forms that all parsers read alike, and put together again
from its checked parts, so that the address that was checked is the one that is connected to. Values of headers can be
secrets: they are in no message, no log and no `repr`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from acp.schema import HttpHeader, HttpMcpServer, McpServerStdio

from backend import wire

SETTING = "agent.mcp_allow"
MAX_SERVERS = 8
MAX_NAME_CHARS = 24
MAX_URL_CHARS = 2048
MAX_HEADERS = 32
MAX_HEADER_CHARS = 8192

# Two underscores separate the server's name from the tool's, so a name has none at its ends and no two in a row.
_NAME = re.compile(r"[A-Za-z0-9-]+(?:_[A-Za-z0-9-]+)*")
# No userinfo, query, fragment, percent sign, backslash or semicolon: parsers differ over each of them.
_URL = re.compile(
    r"(?P<scheme>https?)://(?P<host>[a-z0-9_-]+(?:\.[a-z0-9_-]+)*|\[[0-9a-f:.]+\])(?::(?P<port>[0-9]{1,5}))?"
    r"(?P<path>(?:/[A-Za-z0-9._~@:+,=-]+)*/?)",
)
_DEFAULT_PORTS = {"http": 80, "https": 443}
_HEADER_NAME = re.compile(r"[A-Za-z0-9!#$%&'*+.^_`|~-]{1,128}")
_HEADER_VALUE = re.compile(r"[\x20-\x7e]*")
# They are the transport's. `Host` above all would reach another site behind an address that is allowed.
_OWN_HEADERS = re.compile(
    r"host|connection|keep-alive|te|trailer|transfer-encoding|upgrade|content-.*|accept|accept-encoding|expect"
    r"|proxy-.*|forwarded|x-forwarded-.*|mcp-.*|last-event-id"
)


class ServerRefused(Exception):
    """A client's offer is not taken. `code` is JSON-RPC's; the text says why and what to do."""

    def __init__(self, message: str, code: int = wire.INVALID_PARAMS) -> None:
        super().__init__(message)
        self.code = code


@dataclass(frozen=True)
class Address:
    """An `http(s)://` address in its parts: the host in lower case, the port always there, the path in segments."""

    scheme: str
    host: str
    port: int
    segments: tuple[str, ...]
    slash: bool = field(default=False, compare=False)
    """Whether it ends with a slash, which some servers insist on."""

    @classmethod
    def parse(cls, text: str) -> Address:
        """Raises `ValueError` with what is wrong, without the address itself: it can hold a password."""
        found = None
        if text.isascii() and len(text) <= MAX_URL_CHARS:
            scheme, separator, rest = text.partition("://")
            host, slash, path = rest.partition("/")
            found = _URL.fullmatch(f"{scheme.lower()}{separator}{host.lower()}{slash}{path}")
        if found is None:
            raise ValueError(
                "it must read http(s)://HOST[:PORT][/PATH], without a user, a query, a fragment or a percent sign"
            )
        segments = tuple(found["path"].strip("/").split("/")) if found["path"].strip("/") else ()
        if any(not segment.strip(".") for segment in segments):
            raise ValueError("its path must have no segments of dots alone")
        port = int(found["port"] or _DEFAULT_PORTS[found["scheme"]])
        if not 0 < port < 65536:
            raise ValueError("its port must be a number from 1 to 65535")
        return cls(found["scheme"], found["host"], port, segments, found["path"].endswith("/"))

    def covers(self, other: Address) -> bool:
        """Whether `other` is this address or lies below it, by whole segments of the path."""
        same = (self.scheme, self.host, self.port) == (other.scheme, other.host, other.port)
        return same and other.segments[: len(self.segments)] == self.segments

    def __str__(self) -> str:
        path = "".join(f"/{segment}" for segment in self.segments) + ("/" if self.slash else "")
        return f"{self.scheme}://{self.host}:{self.port}{path}"


@dataclass(frozen=True)
class Offer:
    """A server that may be connected to."""

    name: str
    url: str
    headers: dict[str, str] = field(repr=False)


class AllowList:
    """The addresses of the setting `agent.mcp_allow`, each with what lies below it."""

    def __init__(self, prefixes: Iterable[str]) -> None:
        """Raises `ValueError` for one that is no address."""
        self._allowed: list[Address] = []
        for number, prefix in enumerate(prefixes, 1):
            try:
                self._allowed.append(Address.parse(prefix))
            except ValueError as error:
                raise ValueError(f"{SETTING}: entry {number} cannot be used: {error}.") from None

    def __bool__(self) -> bool:
        """Whether anything is allowed at all."""
        return bool(self._allowed)

    def read(self, servers: Sequence[Any], *, role: str, may_offer: bool) -> tuple[Offer, ...]:
        """The offers of a client, all of them or none. `servers` are the SDK's types; `may_offer` is the right of
        the one who asks. Raises `ServerRefused`."""
        if len(servers) > MAX_SERVERS:
            raise ServerRefused(f"A session takes at most {MAX_SERVERS} MCP servers; these are {len(servers)}.")
        for server in servers:
            _must_be_http(server)
        if servers and not may_offer:
            raise ServerRefused(
                f"Only a supervisor may bring MCP servers into a session; your role is {role}. "
                "Send an empty mcpServers list, or ask a supervisor.",
                wire.NOT_ALLOWED,
            )
        offers = tuple(self._offer(server) for server in servers)
        names = [offer.name.lower() for offer in offers]
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise ServerRefused(f"Two of the MCP servers are called {twice}. Give each a name of its own.")
        return offers

    def _offer(self, server: HttpMcpServer) -> Offer:
        if len(server.name) > MAX_NAME_CHARS or not _NAME.fullmatch(server.name):
            raise ServerRefused(
                f"The name of an MCP server begins the names of its tools: at most {MAX_NAME_CHARS} letters, digits, - "
                "and single _ between them. Give it such a name."
            )
        try:
            address = Address.parse(server.url)
        except ValueError as error:
            raise ServerRefused(f"The address of the MCP server {server.name} cannot be used: {error}.") from None
        if not any(allowed.covers(address) for allowed in self._allowed):
            raise ServerRefused(
                f"The address of the MCP server {server.name} is not on the list of this robot. "
                f"Whoever runs the robot can add it to the setting {SETTING}; until then send the session without it."
            )
        return Offer(server.name, str(address), _headers(server.name, server.headers))


def _must_be_http(server: Any) -> None:
    if isinstance(server, HttpMcpServer):
        return
    if isinstance(server, McpServerStdio):
        raise ServerRefused(
            "This robot takes no stdio MCP servers: they are commands on the robot's computer. "
            "Offer the server over HTTP, or send an empty mcpServers list."
        )
    raise ServerRefused(
        f"This robot takes no MCP servers of the type {server.type}. "
        "Offer the server over HTTP (Streamable HTTP, type http), or send an empty mcpServers list."
    )


def _headers(server: str, headers: Sequence[HttpHeader]) -> dict[str, str]:
    if len(headers) > MAX_HEADERS:
        raise ServerRefused(f"The MCP server {server} has {len(headers)} headers; at most {MAX_HEADERS} are taken.")
    taken: dict[str, str] = {}
    for number, header in enumerate(headers, 1):
        name = header.name.lower()
        # The text names the header by its number: clients have put a value where the name belongs.
        which = f"Header {number} of the MCP server {server}"
        if not _HEADER_NAME.fullmatch(name):
            raise ServerRefused(f"{which} has a name that HTTP does not take.")
        if _OWN_HEADERS.fullmatch(name):
            raise ServerRefused(f"{which} belongs to the connection itself. Leave it out.")
        if name in taken:
            raise ServerRefused(f"{which} is there twice. Send it once.")
        if len(header.value) > MAX_HEADER_CHARS or not _HEADER_VALUE.fullmatch(header.value):
            raise ServerRefused(
                f"{which} has a value that is not taken: at most {MAX_HEADER_CHARS} printable ASCII characters."
            )
        taken[name] = header.value
    return taken
