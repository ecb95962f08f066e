"""The part of viser's WebSocket protocol that the proxy speaks itself, so that nothing of a browser reaches viser.

From the page: where its camera stands, and clicks. To the page: where its camera shall stand, and whether clicks are
wanted. Both belong to one viewer alone, and viser does not tell which of its clients that is. The format belongs to
viser's version, which pages and server check by the WebSocket's subprotocol.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from typing import Any

import msgspec
import zstandard  # viser brings it

from backend.bridge.scene.camera import View
from backend.bridge.scene.eye import Report

MAX_FRAME_BYTES = 4096
"""What a page says of its camera has 400."""

Triple = tuple[float, float, float]


class _Camera(msgspec.Struct, frozen=True, tag_field="type", tag="ViewerCameraMessage"):
    position: Triple
    look_at: Triple
    image_width: int
    image_height: int


class _Pointer(msgspec.Struct, frozen=True, tag_field="type", tag="ScenePointerMessage"):
    event_type: str
    ray_origin: Triple | None
    ray_direction: Triple | None


class Click(msgspec.Struct, frozen=True):
    """A click into the scene: the ray from the camera through the pixel, in the map frame."""

    origin: Triple
    direction: Triple


_compressor = zstandard.ZstdCompressor(level=1)  # of one thread, the event loop's
_decoder: msgspec.msgpack.Decoder[_Camera | _Pointer] = msgspec.msgpack.Decoder(_Camera | _Pointer)


def decode(frame: bytes) -> Report | Click | None:
    """What a page says; None for what nobody here listens to."""
    if len(frame) > MAX_FRAME_BYTES:
        return None
    try:
        said = _decoder.decode(frame)
    except (msgspec.ValidationError, msgspec.DecodeError):
        return None
    if isinstance(said, _Camera):
        if said.image_width <= 0 or said.image_height <= 0 or not _finite(*said.position, *said.look_at):
            return None
        return Report(View(said.position, said.look_at), said.image_width / said.image_height)
    if said.event_type != "click" or said.ray_origin is None or said.ray_direction is None:
        return None
    return Click(said.ray_origin, said.ray_direction) if _finite(*said.ray_origin, *said.ray_direction) else None


def camera(view: View) -> bytes:
    """The frame that puts a page's camera there."""
    return _frame(
        [
            {"type": "SetCameraPositionMessage", "position": view.position, "initial": False},
            {"type": "SetCameraLookAtMessage", "look_at": view.look_at, "initial": False},
        ]
    )


def clicks(wanted: bool) -> bytes:
    """The frame that has a page report clicks, or not any more."""
    modifiers = [None] if wanted else []  # a click without a key held down
    return _frame(
        [{"type": "ScenePointerEnableMessage", "event_type": "click", "modifiers": modifiers, "owner": "bridge"}]
    )


def _frame(messages: Iterable[dict[str, Any]]) -> bytes:
    """A window of messages as viser packs it: two sizes, then compressed msgpack."""
    packed = msgspec.msgpack.encode(
        {"messages": list(messages), "timestampSec": time.perf_counter(), "binaryBufferLengths": []}
    )
    compressed = _compressor.compress(packed)
    return len(packed).to_bytes(8, "little") + len(compressed).to_bytes(8, "little") + compressed


def _finite(*values: float) -> bool:
    return all(map(math.isfinite, values))
