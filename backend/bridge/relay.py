"""Relays frames between one client and the agent: plain calls, without tasks or queues of its own.

Each frame is checked once and passed on as the bytes that arrived. Only `initialize` is written anew, to carry the
verified token. This module must never interpret any other method. Where one side is slow, the other one is no longer
read, so nothing accumulates here.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from backend import wire
from backend.bridge.close_codes import CLIENT_LEFT, POLICY_VIOLATION, SERVICE_RESTART, TRY_AGAIN_LATER, CloseReason
from backend.bridge.limits import Limits
from backend.bridge.upstream import Upstream
from backend.bridge.websocket_protocol import WebSocketProtocol

_NEWLINES_TO_SPACES = bytes.maketrans(b"\r\n", b"  ")

log = logging.getLogger(__name__)


class Relay:
    """The relay of one client. `max_frame_bytes` limits a frame in either direction."""

    def __init__(
        self, client: WebSocketProtocol, token: str, connection_id: str, max_frame_bytes: int, limits: Limits
    ) -> None:
        self._client = client
        self._token = token
        self._id = connection_id
        self._max_frame_bytes = max_frame_bytes
        self._limits = limits
        self._loop = asyncio.get_running_loop()
        self._end: asyncio.Future[CloseReason] = self._loop.create_future()
        self._agent: Upstream | None = None  # set by begin
        self._is_initialized = False  # set by the first valid `initialize`
        self._client_is_congested = False
        self._timers: dict[str, asyncio.TimerHandle] = {}

    def begin(self, agent: Upstream) -> None:
        """Relay the client's messages to `agent` from now on."""
        self._agent = agent
        too_late = CloseReason(POLICY_VIOLATION, "The client did not begin with initialize.")
        self._start_timer("first frame", self._limits.first_frame_seconds, lambda: self._finish(too_late))
        self._client.take_over(self)

    async def ended(self) -> CloseReason:
        """Wait until the relay has ended, and return why."""
        return await self._end

    def close(self) -> None:
        """End the relay and its timers."""
        for timer in self._timers.values():
            timer.cancel()
        self._finish(CLIENT_LEFT)

    # Called by the client's connection:

    def client_message(self, message: bytes) -> None:
        """Pass on a valid frame, and answer an invalid one with an error."""
        if self._agent is None or self._end.done():
            return
        try:
            frame = wire.check(message, self._max_frame_bytes)
        except wire.BadFrame as bad:
            if bad.reply is not None and not self._client_is_congested:
                self._client.send_texts([bad.reply])
            return
        if not self._is_initialized and not self._accept_first(frame):
            return
        self._agent.send(self._line(frame))

    def client_congested(self, congested: bool) -> None:
        """Read the agent no further while the client is behind."""
        self._client_is_congested = congested
        if self._agent is None:
            return
        if congested:
            self._agent.pause_reading()
            self._disconnect_when_stalled("client", self._client.unsent, self._abort_client)
        else:
            self._agent.resume_reading()
            self._stop_timer("client")

    # Called by the agent's connection:

    def agent_lines(self, lines: list[bytes]) -> None:
        """Pass on valid lines, and drop others, such as log lines of an agent on stdio.

        Whoever waits for a line that is too large gets an error in its place.
        """
        valid = []
        for line in lines:
            try:
                valid.append(wire.check(line, self._max_frame_bytes).raw)
            except wire.BadFrame as bad:
                if isinstance(bad, wire.FrameTooLarge) and (error := self._in_place_of(line)):
                    valid.append(error)
                log.warning("acp %s: dropped a line of the agent: %s", self._id, bad.message)
        if valid and not self._end.done():
            self._client.send_texts(valid)

    def agent_congested(self, congested: bool) -> None:
        """Read the client no further while the agent is behind."""
        if self._agent is None:
            return
        if congested:
            self._client.pause_reading()
            reason = CloseReason(TRY_AGAIN_LATER, "The agent does not respond.")
            self._disconnect_when_stalled("agent", self._agent.unsent, lambda: self._finish(reason))
        else:
            self._client.resume_reading()
            self._stop_timer("agent")

    def agent_closed(self) -> None:
        """End the relay, so that the client can connect again."""
        self._finish(CloseReason(SERVICE_RESTART, "The agent has stopped."))

    # Called by this class alone:

    def _in_place_of(self, line: bytes) -> bytes | None:
        """The error for the client in place of an answer that is too large; the agent is sent the one for a request."""
        waiting = wire.who_waits(line)
        if waiting is None:
            return None
        kind, request_id = waiting
        sentence = f"The agent's message is larger than the {self._max_frame_bytes} bytes that the bridge passes on."
        error = wire.error_frame(request_id, wire.INTERNAL_ERROR, sentence)
        if kind == "response":
            return error
        if self._agent is not None:
            self._agent.send(error)
        return None

    def _accept_first(self, frame: wire.Frame) -> bool:
        """Whether the client's first frame is `initialize`; answers any other one and ends the relay."""
        if frame.method == "initialize":
            self._is_initialized = True
            self._stop_timer("first frame")
            return True
        sentence = "The first message must be initialize."
        request_id = frame.id if frame.kind == "request" else None
        self._client.send_texts([wire.error_frame(request_id, wire.INVALID_REQUEST, sentence)])
        self._finish(CloseReason(POLICY_VIOLATION, sentence))
        return False

    def _line(self, frame: wire.Frame) -> bytes:
        if frame.method == "initialize":
            return wire.with_identity(frame, self._token)
        if b"\n" in frame.raw or b"\r" in frame.raw:
            # These are white space between values, as no JSON string contains them unescaped. A newline would end the
            # line too early.
            return frame.raw.translate(_NEWLINES_TO_SPACES)
        return frame.raw

    def _disconnect_when_stalled(self, side: str, unsent: Callable[[], int], disconnect: Callable[[], None]) -> None:
        """Call `disconnect` when `unsent` has not shrunk within `stall_seconds`: a slow side is not a stalled one."""
        before = unsent()

        def check() -> None:
            if unsent() < before:
                self._disconnect_when_stalled(side, unsent, disconnect)
            else:
                disconnect()

        self._start_timer(side, self._limits.stall_seconds, check)

    def _abort_client(self) -> None:
        self._finish(CloseReason(POLICY_VIOLATION, "The client does not read."))
        self._client.abort()  # a close frame would wait behind everything that the client does not read

    def _start_timer(self, name: str, seconds: float, callback: Callable[[], None]) -> None:
        self._stop_timer(name)
        self._timers[name] = self._loop.call_later(seconds, callback)

    def _stop_timer(self, name: str) -> None:
        if timer := self._timers.pop(name, None):
            timer.cancel()

    def _finish(self, reason: CloseReason) -> None:
        if not self._end.done():
            self._end.set_result(reason)
