"""`WS /camera`: the pictures of the robot's camera, one JPEG a frame, for everyone who is logged in.

The newest picture alone waits for a slow client. The robot takes pictures only while somebody watches, once for all.
Nothing that a client sends is accepted.
"""

from __future__ import annotations

from starlette.websockets import WebSocket

from backend.bridge.close_codes import CLIENT_LEFT, POLICY_VIOLATION, CloseReason
from backend.bridge.first_completed import first_completed
from backend.bridge.login import Authenticator, Login
from backend.bridge.scene.conflating_queue import send_newest
from backend.bridge.scene.scene import Scene

_NO_MESSAGES = CloseReason(POLICY_VIOLATION, "The camera takes no messages.")


class RobotCameraSocket:
    """Serves the WebSockets of those who watch the robot's camera."""

    def __init__(self, authenticator: Authenticator, scene: Scene) -> None:
        self._authenticator = authenticator
        self._scene = scene

    async def serve(self, websocket: WebSocket, login: Login) -> CloseReason:
        """Send pictures to one client until it leaves or its login ends."""
        await websocket.accept()
        with self._scene.pictures() as pictures:
            return await first_completed(
                _wait_for_client(websocket),
                send_newest(pictures, websocket.send_bytes),
                self._authenticator.until_login_ends(login),
            )


async def _wait_for_client(websocket: WebSocket) -> CloseReason:
    message = await websocket.receive()
    return CLIENT_LEFT if message["type"] == "websocket.disconnect" else _NO_MESSAGES
