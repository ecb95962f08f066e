"""uvicorn's WebSocket, with a way past the ASGI queue for an endpoint that only passes frames on.

Through ASGI every frame costs two turns of the event loop, and reading from the socket is switched off and
on again; the bytes become text and bytes again. A relay needs none of that, but it needs what ASGI lacks: to know
when the peer reads slowly, and to cut it off. The handshake, pings, fragments and closing stay uvicorn's.
"""

from __future__ import annotations

import asyncio
from typing import Any, Protocol, cast

from starlette.types import Scope
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.exceptions import InvalidState
from websockets.http11 import Request

_EXTENSION = "robot-acp.direct"


class Receiver(Protocol):
    """Whoever took a WebSocket over. Its methods are called from the event loop and may not wait."""

    def client_said(self, message: bytes) -> None:
        """A whole message came, text or binary."""

    def client_slow(self, slow: bool) -> None:
        """The peer's side of the connection is full, or has room again."""


class DirectWebSocket(WebSocketsSansIOProtocol):
    """One connection. It is plain ASGI until `take_over`, and its end is always told through ASGI."""

    _receiver: Receiver | None = None  # set by take_over

    @staticmethod
    def of(scope: Scope) -> DirectWebSocket:
        """The connection behind an ASGI scope; it has to be served with `ws=DirectWebSocket`."""
        return cast(DirectWebSocket, scope["extensions"][_EXTENSION])

    def take_over(self, receiver: Receiver) -> None:
        """Give `receiver` every message from here on, those that wait in the queue first."""
        self._receiver = receiver
        waiting: asyncio.Queue[Any] = self.queue
        for _ in range(waiting.qsize()):
            event = waiting.get_nowait()
            if event["type"] == "websocket.receive":
                text = event.get("text")
                receiver.client_said(event["bytes"] if text is None else text.encode())
            else:
                waiting.put_nowait(event)
        self.resume_reading()

    def send_texts(self, messages: list[bytes]) -> None:
        """Send each as one text message, in one write. After the end of the connection, do nothing."""
        if self.close_sent or self.transport.is_closing():
            return
        try:
            for message in messages:
                self.conn.send_text(message)
        except InvalidState:  # the peer is closing; its close frame ends the connection
            return
        self.transport.write(b"".join(self.conn.data_to_send()))

    def pause_reading(self) -> None:
        """Read no more for now, so that the peer's messages wait in its own buffers."""
        self.read_paused = True  # uvicorn reads on to see the peer's close, where it knows of the pause
        self.transport.pause_reading()

    def resume_reading(self) -> None:
        """Read on."""
        self.read_paused = False
        self.transport.resume_reading()

    def unsent(self) -> int:
        """Bytes that wait for the peer to read."""
        return self.transport.get_write_buffer_size()

    def abort(self) -> None:
        """Cut the connection, with whatever still waits to be sent."""
        self.transport.abort()

    # What uvicorn calls.

    def handle_connect(self, event: Request) -> None:
        """Add the extension to the scope of a WebSocket that was asked for properly."""
        super().handle_connect(event)
        if self.response.status_code == 101:
            cast(dict[str, object], self.scope["extensions"])[_EXTENSION] = self

    def send_receive_event_to_app(self) -> None:
        """Hand a whole message on."""
        if self._receiver is None:
            super().send_receive_event_to_app()
            return
        message = self.frames[0] if len(self.frames) == 1 else b"".join(self.frames)
        self.frames = []
        if not self.close_sent:
            self._receiver.client_said(message)

    def pause_writing(self) -> None:
        """Tell that the peer is slow."""
        super().pause_writing()
        if self._receiver is not None:
            self._receiver.client_slow(True)

    def resume_writing(self) -> None:
        """Tell that the peer has caught up."""
        super().resume_writing()
        if self._receiver is not None:
            self._receiver.client_slow(False)
