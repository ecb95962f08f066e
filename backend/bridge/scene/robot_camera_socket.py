"""`WS /camera`: what the robot's camera sees, a JPEG a frame, while somebody looks.

The newest picture alone waits for a slow reader. The robot is asked for pictures once, whoever looks.
"""

from __future__ import annotations

from starlette.websockets import WebSocket

from backend.bridge.closing import LEFT, POLICY_VIOLATION, End
from backend.bridge.login import Gate, Login
from backend.bridge.race import first_of
from backend.bridge.scene.outgoing import send_latest
from backend.bridge.scene.scene import Scene

_LISTENS_TO_NOTHING = End(POLICY_VIOLATION, "The camera takes no messages.")


class CameraSocket:
    """The WebSocket of one who looks."""

    def __init__(self, gate: Gate, scene: Scene) -> None:
        self._gate = gate
        self._scene = scene

    async def serve(self, websocket: WebSocket, login: Login) -> End:
        """Show pictures until whoever looks is gone, or their login ends."""
        await websocket.accept()
        with self._scene.pictures() as pictures:
            return await first_of(
                _until_left(websocket), send_latest(pictures, websocket.send_bytes), self._gate.until_ended(login)
            )


async def _until_left(websocket: WebSocket) -> End:
    message = await websocket.receive()
    return LEFT if message["type"] == "websocket.disconnect" else _LISTENS_TO_NOTHING
