"""The two directions between one client and the agent: plain calls, no tasks, no queues of its own.

A frame is checked once and passed on as the bytes that came; only `initialize` is written anew, to carry the
verified token. What a method means is none of this module's business. Where one side is slow, the other is no
longer read, so nothing piles up here.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from backend import wire
from backend.bridge.closing import LEFT, POLICY_VIOLATION, SERVICE_RESTART, TRY_AGAIN_LATER, End
from backend.bridge.direct import DirectWebSocket
from backend.bridge.upstream import Upstream

FIRST_FRAME_SECONDS = 30.0
STALL_SECONDS = 15.0
"""How long a side may take nothing of what waits for it before the connection is cut."""

_ONE_LINE = bytes.maketrans(b"\r\n", b"  ")

log = logging.getLogger(__name__)


class Relay:
    """One client and one agent. It hears both sides, and says through `ended` why it is over."""

    def __init__(self, client: DirectWebSocket, token: str, connection_id: str, limit: int) -> None:
        self._client = client
        self._token = token
        self._id = connection_id
        self._limit = limit
        self._loop = asyncio.get_running_loop()
        self._end: asyncio.Future[End] = self._loop.create_future()
        self._agent: Upstream | None = None  # set by begin
        self._initialized = False  # set by the first good frame
        self._client_is_slow = False
        self._timers: dict[str, asyncio.TimerHandle] = {}

    def begin(self, agent: Upstream) -> None:
        """Take what the client says from here on."""
        self._agent = agent
        late = End(POLICY_VIOLATION, "The client did not begin with initialize.")
        self._start_timer("first frame", FIRST_FRAME_SECONDS, lambda: self._finish(late))
        self._client.take_over(self)

    async def ended(self) -> End:
        """Wait for the end, and say why."""
        return await self._end

    def close(self) -> None:
        """Hear no more."""
        for timer in self._timers.values():
            timer.cancel()
        self._finish(LEFT)

    # What the client's side calls.

    def client_said(self, message: bytes) -> None:
        """Pass a good frame on, and answer a bad one."""
        if self._agent is None or self._end.done():
            return
        try:
            frame = wire.check(message, self._limit)
        except wire.BadFrame as bad:
            if bad.reply is not None and not self._client_is_slow:
                self._client.send_texts([bad.reply])
            return
        if not self._initialized and not self._begins_well(frame):
            return
        self._agent.send(self._line(frame))

    def client_slow(self, slow: bool) -> None:
        """Let the agent wait for a client that is behind."""
        self._client_is_slow = slow
        if self._agent is None:
            return
        if slow:
            self._agent.pause_reading()
            self._watch("client", self._client.unsent, self._cut_off)
        else:
            self._agent.resume_reading()
            self._stop_timer("client")

    # What the agent's side calls.

    def agent_said(self, lines: list[bytes]) -> None:
        """Pass good lines on, and drop what is no message, such as a log line of an agent on stdio."""
        good = []
        for line in lines:
            try:
                good.append(wire.check(line, self._limit).raw)
            except wire.BadFrame as bad:
                log.warning("acp %s: dropped a line of the agent: %s", self._id, bad.message)
        if good and not self._end.done():
            self._client.send_texts(good)

    def agent_slow(self, slow: bool) -> None:
        """Let the client wait for an agent that is behind."""
        if self._agent is None:
            return
        if slow:
            self._client.pause_reading()
            end = End(TRY_AGAIN_LATER, "The agent does not respond.")
            self._watch("agent", self._agent.unsent, lambda: self._finish(end))
        else:
            self._client.resume_reading()
            self._stop_timer("agent")

    def agent_gone(self) -> None:
        """End, so that the client can connect anew."""
        self._finish(End(SERVICE_RESTART, "The agent has stopped."))

    # What only this class calls.

    def _begins_well(self, frame: wire.Frame) -> bool:
        if frame.method == "initialize":
            self._initialized = True
            self._stop_timer("first frame")
            return True
        sentence = "The first message must be initialize."
        request_id = frame.id if frame.kind == "request" else None
        self._client.send_texts([wire.error_frame(request_id, wire.INVALID_REQUEST, sentence)])
        self._finish(End(POLICY_VIOLATION, sentence))
        return False

    def _line(self, frame: wire.Frame) -> bytes:
        if frame.method == "initialize":
            return wire.with_identity(frame, self._token)
        if b"\n" in frame.raw or b"\r" in frame.raw:
            # White space, as JSON strings hold neither byte; left in, it would end the line too early.
            return frame.raw.translate(_ONE_LINE)
        return frame.raw

    def _watch(self, what: str, unsent: Callable[[], int], stalled: Callable[[], None]) -> None:
        """Call `stalled` once a whole STALL_SECONDS has taken nothing off `unsent`: slow is not stalled."""
        before = unsent()

        def look() -> None:
            if unsent() < before:
                self._watch(what, unsent, stalled)
            else:
                stalled()

        self._start_timer(what, STALL_SECONDS, look)

    def _cut_off(self) -> None:
        self._finish(End(POLICY_VIOLATION, "The client does not read."))
        self._client.abort()  # a close frame would wait behind all that it does not read

    def _start_timer(self, what: str, seconds: float, then: Callable[[], None]) -> None:
        self._stop_timer(what)
        self._timers[what] = self._loop.call_later(seconds, then)

    def _stop_timer(self, what: str) -> None:
        if timer := self._timers.pop(what, None):
            timer.cancel()

    def _finish(self, end: End) -> None:
        if not self._end.done():
            self._end.set_result(end)
