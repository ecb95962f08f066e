"""A page of viser without a browser: it connects to the scene's WebSocket and keeps what it is told to draw.

It reads viser's protocol by itself, so that tests see what a browser would see and nothing of the server's inside.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import msgspec
import numpy as np
import viser
import zstandard
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from backend.bridge.scene.viser_port import SECRET_HEADERS

SUBPROTOCOL = f"viser-v{viser.__version__}"

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
CLICK = {
    "type": "ScenePointerMessage",
    "event_type": "click",
    "ray_origin": (0.0, 0.0, 0.0),
    "ray_direction": (0.0, 0.0, -1.0),
    "screen_pos": ((0.5, 0.5),),
    "modifier": None,
}

_AS_CREATED = {"visible": True, "position": (0.0, 0.0, 0.0), "wxyz": (1.0, 0.0, 0.0, 0.0)}


def messages_in(frame: bytes) -> list[dict[str, Any]]:
    """The messages of one frame that a page receives, with arrays for what is sent as raw bytes."""
    size, packed = (int.from_bytes(frame[at : at + 8], "little") for at in (0, 8))
    unpacked = zstandard.ZstdDecompressor().decompress(frame[16 : 16 + packed])
    assert len(unpacked) == size
    window = msgspec.msgpack.decode(unpacked)
    buffers, at = [], 16 + packed
    for length in window["binaryBufferLengths"]:
        at += -at % 8
        buffers.append(frame[at : at + length])
        at += length
    assert at == len(frame)

    def with_arrays(value: Any) -> Any:
        if isinstance(value, dict):
            if "__binary_index" in value:
                return np.frombuffer(buffers[value["__binary_index"]], value["dtype"])
            return {key: with_arrays(inner) for key, inner in value.items()}
        return [with_arrays(inner) for inner in value] if isinstance(value, list) else value

    return [with_arrays(message) for message in window["messages"]]


class ViserPage:
    """What a page draws: `nodes` by name, each with its properties, position, rotation (w, x, y, z) and visibility."""

    def __init__(self, websocket: ClientConnection) -> None:
        self._websocket = websocket
        self.nodes: dict[str, dict[str, Any]] = {"": {}, "/WorldAxes": {}}  # those that every page has by itself
        self.is_complete = False
        """Whether all has arrived that was drawn before this page connected."""
        self.replayed = 0
        """How many messages that took."""
        self.changes: list[tuple[str, str]] = []
        """Type and node of each message after that."""

    async def read(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            async for frame in self._websocket:
                for message in messages_in(frame):
                    self._apply(message)

    def visible(self, name: str) -> bool:
        return self.nodes[name]["visible"]

    def points(self, name: str) -> np.ndarray:
        """The points (N, 3) of a node, in m."""
        return np.asarray(self.nodes[name]["points"]).reshape(-1, 3)

    def labels(self, folder: str) -> list[str]:
        """The texts of the labels below a name."""
        return [node["text"] for name, node in self.nodes.items() if name.startswith(folder)]

    def _apply(self, message: dict[str, Any]) -> None:
        kind, name = message["type"], message.get("name", "")
        if self.is_complete:
            self.changes.append((kind, name))
        else:
            self.replayed += 1
        if "props" in message and name.startswith("/"):
            self.nodes[name] = _AS_CREATED | message["props"]
        elif kind == "SceneNodeUpdateMessage":
            self.nodes[name] |= message["updates"]
        elif kind == "SetPositionMessage":
            self.nodes[name]["position"] = tuple(message["position"])
        elif kind == "SetOrientationMessage":
            self.nodes[name]["wxyz"] = tuple(message["wxyz"])
        elif kind == "SetSceneNodeVisibilityMessage":
            self.nodes[name]["visible"] = message["visible"]
        elif kind == "RemoveSceneNodeMessage":
            del self.nodes[name]
        elif kind == "ReplayDoneMessage":
            self.is_complete = True


@asynccontextmanager
async def viser_page(opening: connect) -> AsyncIterator[ViserPage]:
    """A page that has received all that was drawn before."""
    async with opening as websocket:
        page = ViserPage(websocket)
        reading = asyncio.create_task(page.read())
        try:
            async with asyncio.timeout(30):
                while not page.is_complete and not reading.done():
                    await asyncio.sleep(0.01)
            yield page
        finally:
            reading.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await reading  # raises what went wrong while reading


def dial(port: int) -> connect:
    """A page's WebSocket to viser itself, past the bridge: nobody counts as watching."""
    return connect(
        f"ws://127.0.0.1:{port}/",
        subprotocols=[SUBPROTOCOL],
        additional_headers=SECRET_HEADERS,
        compression=None,
        max_size=None,
        proxy=None,
    )
