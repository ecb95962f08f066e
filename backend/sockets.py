"""TCP options of the servers' sockets. An option that a system does not have is left out without an error."""

from __future__ import annotations

import socket


def notice_loss(plug: socket.socket, seconds: float, every: int = 1) -> None:
    """Let the kernel end a connection about `seconds` after its other machine was lost.

    A silent peer is probed `every` so many seconds. Connections that a listening socket accepts inherit these options.
    Without them a pulled cable is noticed after a quarter of an hour, or never.
    """
    plug.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in (
        ("TCP_KEEPIDLE", every),
        ("TCP_KEEPINTVL", every),
        ("TCP_KEEPCNT", max(1, round(seconds / every) - 1)),
        ("TCP_USER_TIMEOUT", round(1000 * seconds)),
    ):
        option = getattr(socket, name, None)  # not every system has all of them
        if option is not None:
            plug.setsockopt(socket.IPPROTO_TCP, option, value)
