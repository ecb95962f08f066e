"""Says what people on the network can read where a process listens on any address but loopback.

None of the three processes speaks TLS. The warning is no refusal: a network can be private, and a proxy with TLS can
run on another machine. It never says that an address is safe.
"""

from __future__ import annotations

import logging
from typing import Literal

from backend import addresses
from backend.config import Settings

Process = Literal["robot", "agent", "bridge"]

_READABLE: dict[Process, str] = {
    "robot": "the secret that moves the robot and releases its stop, the camera and the map",
    "agent": "login tokens, conversations and photos",
    "bridge": "login tokens, conversations, the camera and the map",
}
_ADVICE: dict[Process, str] = {
    "robot": "set robot.host to 127.0.0.1 (SECURITY.md)",
    "agent": "set agent.host to 127.0.0.1 and let clients come through the bridge (SECURITY.md)",
    "bridge": "set bridge.host to 127.0.0.1 and put a reverse proxy with TLS in front of it (SECURITY.md)",
}


def warning(settings: Settings, process: Process) -> tuple[str, str] | None:
    """What anybody on the network can read, and what to do, as two parts of a sentence about the process. None for a
    process that only this machine reaches."""
    where = getattr(settings, process)
    if addresses.is_loopback(where.host):
        return None
    at = addresses.authority(where.host, where.port)
    what = f"listens on {at} without TLS, so anybody on that network can read {_READABLE[process]}"
    return what, _ADVICE[process]


def warn(settings: Settings, process: Process, log: logging.Logger) -> None:
    """Log the warning, where there is one, as a process begins."""
    if found := warning(settings, process):
        what, advice = found
        log.warning("the %s %s: %s", process, what, advice)
