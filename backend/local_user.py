"""Which user of this machine is at the other end of a TCP connection over the loopback.

Linux lists every TCP socket with the user who made it, in `/proc/net/tcp` and `/proc/net/tcp6`. The connection's other
end is found there by both its addresses, which no two sockets share. A socket without an inode is no longer held by any
process and has no user: it counts as nobody's. Other systems have no such list. There the agent writes a token for each
of its starts, which the commands of its own user read. Nothing here may say "the same user" in doubt.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from ipaddress import IPv4Address, IPv6Address, ip_address
from pathlib import Path

from backend import identity, private_files
from backend.config import Settings

TABLES = (Path("/proc/net/tcp"), Path("/proc/net/tcp6"))
_OVERFLOW_UID = Path("/proc/sys/kernel/overflowuid")
_TRIES = 3
"""The list is read piece by piece; a socket whose neighbour is closed meanwhile can be missing in it."""


def is_loopback(host: str) -> bool:
    """Whether an address, as the socket gives it, is one of the loopback."""
    return _plain(host).is_loopback


def is_same_user(here: tuple[str, int], there: tuple[str, int]) -> bool:
    """Whether the process at `there` runs as this process's user. `here` is this end of the connection.

    It reads a file whose length is that of all connections of the machine, so an event loop calls it in a thread.
    """
    uid = os.getuid()
    return uid == _uid_of(there, here) and uid != _unknown_uid()


def lists_users() -> bool:
    """Whether this system says which user a TCP client is."""
    return TABLES[0].exists()


def write_token(data_dir: Path, port: int) -> str | None:
    """A new token for the agent at `port`, in a file that only this user reads; None where the system lists users.

    It is new at each start, so that a program that had the port before has learned nothing that is valid now.
    """
    if lists_users():
        return None
    token = identity.new_secret()
    private_files.make_folder(data_dir)
    private_files.write(_token_file(data_dir, port), token)
    return token.decode()


def token_for(url: str, settings: Settings) -> str | None:
    """The token of the agent that the settings name; None for every other address, and where none is needed.

    Raises `UnsafeFile`.
    """
    if lists_users() or url != settings.agent_url:
        return None
    with contextlib.suppress(OSError):
        return private_files.read(_token_file(settings.data_dir, settings.agent.port)).decode()
    return None


def _token_file(data_dir: Path, port: int) -> Path:
    return data_dir / f"local.{port}.token"


def _uid_of(socket: tuple[str, int], peer: tuple[str, int]) -> int | None:
    """The user of the socket that is bound to `socket` and connected to `peer`; None where there is none."""
    wanted = set(zip(_notations(socket), _notations(peer), strict=True))
    for _ in range(_TRIES):
        for line in _lines():
            fields = line.split(maxsplit=10)
            if len(fields) > 9 and (fields[1], fields[2]) in wanted and fields[9] != "0":
                return int(fields[7])
    return None


def _lines() -> Iterator[str]:
    for table in TABLES:
        with contextlib.suppress(OSError), table.open(encoding="ascii") as lines:
            yield from lines


def _notations(socket: tuple[str, int]) -> tuple[str, ...]:
    """An address and port as the tables write them: an IPv4 address also as one that an IPv6 socket has."""
    address, port = _plain(socket[0]), socket[1]
    forms = [address.packed]
    if address.version == 4:
        forms.append(b"\0" * 10 + b"\xff\xff" + address.packed)
    return tuple(f"{_words(form)}:{port:04X}" for form in forms)


def _words(packed: bytes) -> str:
    """The address as numbers of four bytes, each in the byte order of the machine."""
    parts = (packed[start : start + 4] for start in range(0, len(packed), 4))
    return "".join(f"{int.from_bytes(part, sys.byteorder):08X}" for part in parts)


def _plain(host: str) -> IPv4Address | IPv6Address:
    address = ip_address(host.partition("%")[0])
    return getattr(address, "ipv4_mapped", None) or address


def _unknown_uid() -> int:
    """The number that stands for every user whom this process's user namespace does not know."""
    try:
        return int(_OVERFLOW_UID.read_text())
    except (OSError, ValueError):
        return 65534
