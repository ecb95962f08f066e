"""Many viewers in one process: scenes that read viser's frames, or dashboards that watch a session. For viewers.py.

    python bench/crowd.py scenes|dashboards COUNT ws://HOST:PORT SESSION

The login token comes in the environment. It says "ready" when all are connected, runs until its input ends, and prints
what came as a line of JSON. It is nice to the rest of the machine: what is measured is what it costs others, and
in life viewers sit at computers of their own.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
import time
from dataclasses import asdict, dataclass

import msgspec
import orjson
import viser
from shared import Process
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

NICENESS = 15
TELEMETRY_HZ = 2.0
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (3.0, 3.0, 3.0),
    "fov": 0.7,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 500,
    "image_width": 600,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}
"""What viser's page says of itself as soon as it is connected."""


@dataclass
class Came:
    """What all viewers of this process got."""

    viewers: int
    seconds: float = 0.0
    frames: int = 0
    bytes: int = 0
    telemetry: int = 0
    lost: int = 0
    cpu: float = 0.0
    """Seconds of CPU time of this process."""

    def frame(self, frame: str | bytes) -> None:
        """Count one."""
        self.frames += 1
        self.bytes += len(frame)
        if isinstance(frame, str) and '"_robot/telemetry"' in frame[:80]:
            self.telemetry += 1


async def scene(url: str, headers: dict[str, str]) -> ClientConnection:
    """A page of viser, as the bridge sees it."""
    protocol = Subprotocol(f"viser-v{viser.__version__}")
    page = await connect(
        f"{url}/scene", additional_headers=headers, subprotocols=[protocol], compression=None, max_size=None, proxy=None
    )
    await page.send(msgspec.msgpack.encode(CAMERA))
    return page


async def dashboard(url: str, headers: dict[str, str], session: str) -> ClientConnection:
    """A dashboard that shows the session and wants telemetry."""
    page = await connect(f"{url}/acp", additional_headers=headers, compression=None, max_size=None, proxy=None)
    asks = {"robot-acp/telemetry": {"rate": TELEMETRY_HZ}}
    hello = {"protocolVersion": 1, "clientCapabilities": {"_meta": asks}}
    load = {"sessionId": session, "cwd": "/", "mcpServers": []}
    for number, method, params in ((1, "initialize", hello), (2, "session/load", load)):
        message = {"jsonrpc": "2.0", "id": number, "method": method, "params": params}
        await page.send(orjson.dumps(message).decode())
        while orjson.loads(await page.recv()).get("id") != number:
            pass
    return page


async def read(page: ClientConnection, came: Came) -> None:
    """Count until the connection ends, which it does by our leave alone."""
    try:
        async for frame in page:
            came.frame(frame)
    except ConnectionClosed:
        came.lost += 1


async def main(kind: str, count: int, url: str, session: str) -> None:
    """Connect all, one after another, and read until the input ends."""
    headers = {"Authorization": f"Bearer {os.environ['ROBOT_ACP_TOKEN']}"}
    came = Came(count)
    readers: list[asyncio.Task[None]] = []
    for _ in range(count):
        page = await (scene(url, headers) if kind == "scenes" else dashboard(url, headers, session))
        readers.append(asyncio.create_task(read(page, came)))
    loop = asyncio.get_running_loop()
    print("ready", flush=True)
    await loop.run_in_executor(None, sys.stdin.readline)  # "count": from now on
    came.frames = came.bytes = came.telemetry = 0
    begun, mine = time.monotonic(), Process(os.getpid())
    cpu = mine.cpu
    await loop.run_in_executor(None, sys.stdin.readline)
    came.seconds, came.cpu = time.monotonic() - begun, mine.cpu - cpu
    print(json.dumps(asdict(came)), flush=True)
    for reader in readers:
        reader.cancel()
    await asyncio.gather(*readers, return_exceptions=True)


if __name__ == "__main__":
    os.nice(NICENESS)
    asyncio.run(main(sys.argv[1], int(sys.argv[2]), sys.argv[3], sys.argv[4]))
