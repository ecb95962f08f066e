"""A client whose machine is gone says no goodbye: the kernel asks after it, so that it does not count for long."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

import pytest

from backend.agent.server import _PROBE_S
from tests.processes import Robot, eventually

KEEPALIVE = 2
TICKS = 100
"""A second, in the timers of /proc/net/tcp."""


def timer(local: int, remote: int) -> tuple[int, int] | None:
    """The kind of the kernel's timer of a connection of the loopback, and in how many ticks it ends."""
    for line in Path("/proc/net/tcp").read_text().splitlines()[1:]:
        fields = line.split()
        if [int(address.partition(":")[2], 16) for address in fields[1:3]] == [local, remote]:
            kind, _, ticks = fields[5].partition(":")
            return int(kind, 16), int(ticks, 16)
    return None


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux shows the timers of connections")
async def test_the_agent_has_a_silent_client_probed(robot: Robot) -> None:
    _, writer = await asyncio.open_connection("127.0.0.1", robot.agent_port)
    ours = writer.get_extra_info("sockname")[1]

    def probed() -> bool:
        kind, ticks = timer(robot.agent_port, ours) or (0, 0)
        return kind == KEEPALIVE and ticks <= _PROBE_S * TICKS

    await eventually(probed, "the agent to have the client probed")
    writer.close()
