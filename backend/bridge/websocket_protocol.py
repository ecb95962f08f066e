"""uvicorn's WebSocket protocol, extended for a relay: messages can bypass the ASGI queue.

Through ASGI every message costs two turns of the event loop, reading from the socket is switched off and on again, and
bytes become text and bytes again. A relay needs none of that. It needs what ASGI lacks: to know when the client reads
slowly, and to disconnect it. The handshake, pings, fragments and closing remain uvicorn's.

Of what a client sends, little is handled at a time, and no faster than its login's pace: many small messages must not
keep the event loop from Stop. Until a connection is admitted, it counts among those before login, and its messages are
short.

It builds on a class of uvicorn that is not public API: `pyproject.toml` pins uvicorn's minor version.
"""

from __future__ import annotations

import asyncio
from typing import Any, Protocol, cast

from starlette.types import Scope
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.exceptions import InvalidState
from websockets.http11 import Request

from backend.bridge.reading_pace import BYTES_PER_MESSAGE, LONGEST_PAUSE_S
from backend.connections_before_login import ConnectionsBeforeLogin, Use
from backend.rates import TokenBucket

SHORT_MESSAGE_BYTES = 64 * 1024
"""More than is needed before the login, and by the scene."""
_EXTENSION = "robot-acp.websocket"
_READ_BYTES = 2048
"""So much is read from a connection before the others have their turn: 250 messages of the smallest size."""


class MessageReceiver(Protocol):
    """Receives the messages of one WebSocket. Its methods are called from the event loop and must not block."""

    def client_message(self, message: bytes) -> None:
        """A whole message has arrived, text or binary."""

    def client_congested(self, congested: bool) -> None:
        """The client reads too slowly (True), or has caught up (False)."""


class WebSocketProtocol(WebSocketsSansIOProtocol):
    """One connection. It is plain ASGI until `take_over`; its end is always reported through ASGI."""

    _before_login: ConnectionsBeforeLogin | None = None  # set by websocket_protocol
    _receiver: MessageReceiver | None = None  # set by take_over
    _pace: TokenBucket | None = None  # set by admitted
    _pause: asyncio.TimerHandle | None = None  # set while the pace lets nothing be read

    @staticmethod
    def admitted(scope: Scope, pace: TokenBucket, max_bytes: int) -> None:
        """The WebSocket of this scope has a login: it is read at the login's pace, in messages of at most so much."""
        connection: WebSocketProtocol | None = scope.get("extensions", {}).get(_EXTENSION)
        if connection is None:
            return  # a test serves it with another protocol
        connection._pace = pace
        connection.conn.max_message_size = max_bytes
        if connection._before_login is not None:
            connection._before_login.remove(connection)

    @staticmethod
    def of(scope: Scope) -> WebSocketProtocol:
        """The connection of an ASGI scope; the server has to run with `ws=WebSocketProtocol`."""
        return cast(WebSocketProtocol, scope["extensions"][_EXTENSION])

    def take_over(self, receiver: MessageReceiver) -> None:
        """Give `receiver` every message from now on, first those that wait in the ASGI queue."""
        self._receiver = receiver
        waiting: asyncio.Queue[Any] = self.queue
        for _ in range(waiting.qsize()):
            event = waiting.get_nowait()
            if event["type"] == "websocket.receive":
                text = event.get("text")
                receiver.client_message(event["bytes"] if text is None else text.encode())
            else:
                waiting.put_nowait(event)
        self.resume_reading()

    def send_texts(self, messages: list[bytes]) -> None:
        """Send each as one text message, in one write. Does nothing once the connection is closing."""
        if self.close_sent or self.transport.is_closing():
            return
        try:
            for message in messages:
                self.conn.send_text(message)
        except InvalidState:  # the client is closing; its close frame ends the connection
            return
        self.transport.write(b"".join(self.conn.data_to_send()))

    def pause_reading(self) -> None:
        """Stop reading, so that the client's messages wait in its own buffers."""
        self.read_paused = True  # lets uvicorn resume reading when it waits for the client's close frame
        self.transport.pause_reading()

    def resume_reading(self) -> None:
        """Read again."""
        self.read_paused = False
        if self._pause is None:
            self.transport.resume_reading()

    def unsent(self) -> int:
        """The bytes that wait for the client to read them."""
        return self.transport.get_write_buffer_size()

    def abort(self) -> None:
        """Disconnect at once; what waits to be sent is lost."""
        self.transport.abort()

    async def receive(self) -> Any:
        """The next event for ASGI."""
        message = await self.queue.get()
        if self.read_paused and self.queue.empty():
            self.resume_reading()
        return message

    async def send(self, message: Any) -> None:
        """Send what ASGI says. An HTTP answer is a whole answer to a handshake, which uvicorn logs as a missing one."""
        await super().send(message)
        if message["type"] == "websocket.http.response.body" and not message.get("more_body"):
            self.handshake_complete = True

    # Called by uvicorn and the transport:

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Count the connection."""
        super().connection_made(transport)
        self.conn.max_message_size = min(SHORT_MESSAGE_BYTES, self.config.ws_max_size)
        if hasattr(transport, "max_size"):
            transport.max_size = _READ_BYTES  # of asyncio's transports: how much is read at a time
        if self._before_login is not None:
            self._before_login.add(self, self.client[0] if self.client else None, self.transport.abort)
            self._before_login.set_use(self, Use.ANSWERING)

    def connection_lost(self, exc: Exception | None) -> None:
        """Count it no more."""
        if self._before_login is not None:
            self._before_login.remove(self)
        if self._pause is not None:
            self._pause.cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Handle what has arrived."""
        super().data_received(data)
        self._spend(len(data) / BYTES_PER_MESSAGE)

    def handle_events(self) -> None:
        """Handle what was read."""
        messages = len(self.conn.events)
        super().handle_events()
        self._spend(messages)

    def _spend(self, messages: float) -> None:
        """Count what was read; where it was too much, the next is read later."""
        if self._pace is None or self.transport.is_closing():
            return
        wait = self._pace.spend(self.loop.time(), messages)
        if wait and self._pause is None:
            self.transport.pause_reading()
            self._pause = self.loop.call_later(min(wait, LONGEST_PAUSE_S), self._end_pause)

    def _end_pause(self) -> None:
        self._pause = None
        if not self.read_paused:
            self.transport.resume_reading()

    def handle_connect(self, event: Request) -> None:
        """Add this connection to the scope of a WebSocket whose handshake is valid."""
        super().handle_connect(event)
        if self.response.status_code == 101:
            cast(dict[str, object], self.scope["extensions"])[_EXTENSION] = self

    def send_receive_event_to_app(self) -> None:
        """Pass on a whole message."""
        if self._receiver is None:
            super().send_receive_event_to_app()
            return
        message = self.frames[0] if len(self.frames) == 1 else b"".join(self.frames)
        self.frames = []
        if not self.close_sent:
            self._receiver.client_message(message)

    def pause_writing(self) -> None:
        """Report that the client reads too slowly."""
        super().pause_writing()
        if self._receiver is not None:
            self._receiver.client_congested(True)

    def resume_writing(self) -> None:
        """Report that the client has caught up."""
        super().resume_writing()
        if self._receiver is not None:
            self._receiver.client_congested(False)


def websocket_protocol(before_login: ConnectionsBeforeLogin) -> type[WebSocketProtocol]:
    """The class for `uvicorn.Config(ws=…)`."""

    class Counted(WebSocketProtocol):
        _before_login = before_login

    return Counted
