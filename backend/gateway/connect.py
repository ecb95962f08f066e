"""`robot-acp connect`: a remote robot as a stdio agent. stdout carries messages and nothing else."""

from __future__ import annotations

import sys

from backend import wire
from backend.gateway.pipe import Pipe
from backend.gateway.remote import Address, RemoteError
from backend.stdio import stdin, stdout


async def run(address: Address) -> int:
    """Be the agent on stdin and stdout until stdin ends; the exit status is 1 when the remote fails."""
    try:
        remote = await address.connect()
        try:
            async with stdin(wire.MAX_FRAME_BYTES + 1) as reader, stdout() as writer:
                await Pipe(reader, writer, remote).run()
        finally:
            await remote.close()
    except RemoteError as error:
        print(f"robot-acp: {error}", file=sys.stderr)
        return 1
    return 0
