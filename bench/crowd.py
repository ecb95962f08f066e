"""Many dashboards in one process: each watches a session and opens what the page opens beside it. For viewers.py.

    python bench/crowd.py ws://HOST:PORT SESSION SCENES

A login token for each comes as the first line of its input; the first SCENES of them show the scene. It says "ready"
when all are connected, runs until its input ends, and prints what came as a line of JSON. It is nice to the rest of the
machine: what is measured is what it costs others, and in life viewers sit at computers of their own.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
import time
import uuid
from dataclasses import asdict, dataclass, field

import msgspec
import orjson
import viser
from shared import Process
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

from backend.descriptors import raise_limit

NICENESS = 15
PATIENCE_S = 60.0
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
    """What all dashboards of this process got."""

    sockets: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0
    frames: dict[str, int] = field(default_factory=dict)
    bytes: dict[str, int] = field(default_factory=dict)
    telemetry: int = 0
    lost: int = 0
    cpu: float = 0.0
    """Seconds of CPU time of this process."""

    def frame(self, kind: str, frame: str | bytes) -> None:
        """Count one."""
        self.frames[kind] += 1
        self.bytes[kind] += len(frame)
        if isinstance(frame, str) and '"_robot/telemetry"' in frame[:80]:
            self.telemetry += 1

    def begin(self) -> None:
        """Count from now on."""
        self.frames = dict.fromkeys(self.sockets, 0)
        self.bytes = dict.fromkeys(self.sockets, 0)
        self.telemetry = 0


async def opened(url: str, token: str, *subprotocols: str) -> ClientConnection:
    """One socket of a page."""
    return await connect(
        url,
        additional_headers={"Authorization": f"Bearer {token}"},
        subprotocols=[Subprotocol(name) for name in subprotocols] or None,
        compression=None,
        max_size=None,
        proxy=None,
        open_timeout=PATIENCE_S,
    )


async def dashboard(url: str, token: str, session: str, *, scene: bool) -> dict[str, ClientConnection]:
    """The sockets of one dashboard, by kind."""
    viewer = uuid.uuid4()
    page = {
        "acp": await acp(url, token, session),
        "control": await opened(f"{url}/scene/{viewer}/control", token),
        "camera": await opened(f"{url}/camera", token),
    }
    if scene:
        page["scene"] = await opened(f"{url}/scene/{viewer}", token, f"viser-v{viser.__version__}")
        await page["scene"].send(msgspec.msgpack.encode(CAMERA))
    return page


async def acp(url: str, token: str, session: str) -> ClientConnection:
    """A client that shows the session and wants telemetry."""
    page = await opened(f"{url}/acp", token)
    asks = {"robot-acp/telemetry": {"rate": TELEMETRY_HZ}}
    hello = {"protocolVersion": 1, "clientCapabilities": {"_meta": asks}}
    load = {"sessionId": session, "cwd": "/", "mcpServers": []}
    for number, method, params in ((1, "initialize", hello), (2, "session/load", load)):
        message = {"jsonrpc": "2.0", "id": number, "method": method, "params": params}
        await page.send(orjson.dumps(message).decode())
        while orjson.loads(await page.recv()).get("id") != number:
            pass
    return page


async def read(kind: str, page: ClientConnection, came: Came) -> None:
    """Count until the connection ends, which it does by our leave alone."""
    try:
        async for frame in page:
            came.frame(kind, frame)
    except ConnectionClosed:
        came.lost += 1


async def main(url: str, session: str, scenes: int) -> None:
    """Connect all, one after another, and read until the input ends."""
    came = Came()
    came.begin()
    readers: list[asyncio.Task[None]] = []
    for number, token in enumerate(sys.stdin.readline().split()):
        for kind, page in (await dashboard(url, token, session, scene=number < scenes)).items():
            came.sockets[kind] = came.sockets.get(kind, 0) + 1
            came.frames.setdefault(kind, 0)
            came.bytes.setdefault(kind, 0)
            readers.append(asyncio.create_task(read(kind, page, came)))
    loop = asyncio.get_running_loop()
    print("ready", flush=True)
    await loop.run_in_executor(None, sys.stdin.readline)  # "count": from now on
    came.begin()
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
    raise_limit(0)
    asyncio.run(main(sys.argv[1], sys.argv[2], int(sys.argv[3])))
