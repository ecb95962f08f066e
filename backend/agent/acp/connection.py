"""One client connection of the agent: checked frames in, one ordered outbox out.

Everything that goes to the client, answers, questions and the events of its sessions, passes the one outbox, so
their order on the wire is the order in which they were made. What is only ever of use while it is new has a place
beside it, for one of each kind. A client that does not read is cut off; it never makes anybody wait. No text of an
exception leaves through here.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import uuid
from collections import deque
from collections.abc import Callable, Coroutine
from contextvars import ContextVar
from typing import Any

import orjson
from acp.connection import Connection
from acp.exceptions import RequestError
from acp.router import MessageRouter
from pydantic import ValidationError

from backend import meta as keys
from backend import wire
from backend.identity import Identity, Right

log = logging.getLogger(__name__)

ROOM_BYTES = 1024 * 1024
DISMISS_S = 1.0
"""How long somebody who has to leave may take to read what waits."""
META_ARGUMENT = "meta"
"""The SDK spreads `_meta` over a handler's arguments; here it arrives whole, under this one name."""


_follow_ups: ContextVar[list[Callable[[], None]]] = ContextVar("follow_ups")


def after_the_answer(follow_up: Callable[[], None]) -> None:
    """Call this once the request that is being handled has been answered."""
    _follow_ups.get().append(follow_up)


class ClientConnection:
    """The SDK's transport over an NDJSON stream, and a session's listener.

    `identity` is set by `initialize` or `authenticate`; it is None before.
    """

    def __init__(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, local: bool, max_outbox_bytes: int
    ) -> None:
        self.id = uuid.uuid4().hex[:8]
        self.local = local
        self.identity: Identity | None = None
        self.initialized = False
        self.client_capabilities: dict[str, Any] = {}
        self._reader = reader
        self._writer = writer
        self._max_outbox_bytes = max_outbox_bytes
        self._outbox: deque[bytes] = deque()
        self._outbox_bytes = 0
        self._filled = asyncio.Event()
        self._latest: dict[str, bytes] = {}
        """Method -> a frame that only counts until the next one; it waits here, outside of the outbox."""
        self._drained = asyncio.Event()
        """Set while nothing waits in the outbox."""
        self._drained.set()
        self._closed = False
        self._dispatched: deque[wire.Frame] = deque()
        """Messages that the SDK has and whose handler has not begun; handlers begin in this order."""
        self._running: dict[wire.RequestId, tuple[wire.Frame, asyncio.Future[Any]]] = {}
        """The requests of the client that are being handled."""
        self._withdrawn: set[wire.RequestId] = set()
        self._asked = 0
        self._answers: dict[str, asyncio.Future[Any]] = {}
        """The questions to the client that are open, by request id."""

    @property
    def name(self) -> str:
        """Who this is, for people."""
        return self.identity.name if self.identity else "somebody"

    @property
    def may_approve(self) -> bool:
        """Whether permission questions go to this connection."""
        who = self.identity
        return who is not None and not who.expired and who.may(Right.APPROVE)

    @property
    def takes_files(self) -> bool:
        """Whether the client said that it writes files."""
        return bool((self.client_capabilities.get("fs") or {}).get("writeTextFile"))

    @property
    def takes_people(self) -> bool:
        """Whether the client asked to be told who is connected."""
        return (self.client_capabilities.get("_meta") or {}).get(keys.PEOPLE) is True

    @property
    def takes_forms(self) -> bool:
        """Whether the client said that it shows forms."""
        return isinstance((self.client_capabilities.get("elicitation") or {}).get("form"), dict)

    async def serve(self, router: MessageRouter) -> None:
        """Handle messages until the client goes away."""
        rpc = Connection(_Guarded(router, self), self, listening=False)
        sender = asyncio.create_task(self._send_outbox(), name=f"outbox {self.id}")
        try:
            await rpc.main_loop()
            await self._let_begin()
        finally:
            for answer in self._answers.values():
                if not answer.done():
                    answer.set_exception(ConnectionError("the client is gone"))
            await rpc.close()
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, OSError):
                await sender
            self._writer.write(b"".join(self._outbox))
            self._writer.close()

    # What the SDK wants of a transport.

    async def receive(self) -> dict[str, Any] | None:
        """The next checked message; None at the end. What is wrong is answered here, and reading goes on."""
        while not self._closed:
            try:
                line = await wire.read_line(self._reader)
                if line is None:
                    return None
                frame = wire.check(line)
            except wire.BadFrame as bad:
                if not self.initialized:
                    return None  # whoever speaks first and wrongly is no ACP client: a web page, a port scan
                if bad.reply is not None:
                    self.deliver(bad.reply + b"\n")
                continue
            except OSError:
                return None
            if not self.initialized:
                if frame.kind != "request" or frame.method != "initialize":
                    return None
                self.initialized = True
            if frame.kind == "response":
                self._take_answer(frame)
                continue
            if frame.method == "$/cancel_request" and frame.kind == "notification":
                cancel = self._withdraw(frame)
                if cancel is None:
                    continue
                frame = cancel
            self._dispatched.append(frame)
            return _with_wrapped_meta(frame.body)
        return None

    async def _let_begin(self) -> None:
        """Return when every handler has taken its first step: the end cancels them, and a cancel with which somebody
        leaves has to reach its turn."""
        for _ in ("the message", "its handler", "what that awaits first"):
            await asyncio.sleep(0)

    def _withdraw(self, notification: wire.Frame) -> wire.Frame | None:
        """Cancel a request of the client, which is answered all the same. A prompt ends as its turn does, so for
        one this returns the `session/cancel` that means the same."""
        request_id = (notification.body.get("params") or {}).get("requestId")
        if request_id is None or not wire.valid_id(request_id):
            return None
        waiting = [frame for frame in self._dispatched if frame.kind == "request" and frame.id == request_id]
        frame, handler = self._running.get(request_id) or (waiting[0] if waiting else None, None)
        if frame is None:
            return None  # it has been answered
        if frame.method == "session/prompt":
            session_id = (frame.body.get("params") or {}).get("sessionId")
            body = {"jsonrpc": "2.0", "method": "session/cancel", "params": {"sessionId": session_id}}
            return wire.Frame("notification", "session/cancel", None, body, b"")
        self._withdrawn.add(request_id)
        if handler is not None:
            handler.cancel()
        return None

    async def handle(self, work: Coroutine[Any, Any, Any]) -> Any:
        """Run the handler of the message that was dispatched first of those that have not begun."""
        frame = self._dispatched.popleft()
        follow_ups: list[Callable[[], None]] = []
        _follow_ups.set(follow_ups)
        handler = asyncio.ensure_future(work)  # notifications too: a cancel must not overtake its prompt
        if frame.kind != "request":
            return await handler
        self._running[frame.id] = (frame, handler)
        try:
            if frame.id in self._withdrawn:
                handler.cancel()
            answer = await handler
            for follow_up in follow_ups:
                asyncio.get_running_loop().call_soon(follow_up)  # the SDK sends the answer before it yields
            return answer
        except asyncio.CancelledError:
            if frame.id in self._withdrawn:
                raise RequestError(wire.CANCELLED, "Cancelled.") from None
            raise
        finally:
            self._running.pop(frame.id, None)
            self._withdrawn.discard(frame.id)

    def _take_answer(self, frame: wire.Frame) -> None:
        answer = self._answers.get(str(frame.id))
        if answer is None or answer.done():
            return  # a second answer, or one to a question that was withdrawn
        if "error" in frame.body:
            answer.set_exception(RequestError(wire.INTERNAL_ERROR, "The client answered with an error."))
        else:
            answer.set_result(frame.body["result"])

    async def send(self, message: dict[str, Any]) -> None:
        """Send an answer or a question soon."""
        self.deliver(orjson.dumps(message, option=orjson.OPT_APPEND_NEWLINE))

    async def close(self) -> None:
        """Stop reading; what is in the outbox still goes out."""
        self._closed = True

    async def dismiss(self) -> None:
        """The login is over: this is nobody now, whose open questions are withdrawn. Returns when that has gone out."""
        self.identity = None
        for request_id, answer in list(self._answers.items()):
            if not answer.done():
                answer.set_exception(ConnectionError("the login is over"))
                await self.notify("$/cancel_request", {"requestId": request_id})
        try:
            async with asyncio.timeout(DISMISS_S):
                await self._drained.wait()
        except TimeoutError:
            self._writer.transport.abort()

    # What a session wants of a listener.

    def deliver(self, frame: bytes) -> None:
        """Put a line into the outbox; a client that has let too much pile up is cut off."""
        if self._closed:
            return
        self._outbox.append(frame)
        self._outbox_bytes += len(frame)
        self._drained.clear()
        self._filled.set()
        self.behind(0)

    def show_latest(self, method: str, frame: bytes) -> None:
        """Send a line soon, unless a newer one of its method comes first: for what is of no use once it is old."""
        self._latest[method] = frame
        self._filled.set()

    def behind(self, held_bytes: int) -> None:
        """Cut the client off when what waits here, and `held_bytes` that are held elsewhere for it, is too much."""
        if self._outbox_bytes + held_bytes > self._max_outbox_bytes and not self._closed:
            log.warning("connection %s of %s does not read; it is cut off", self.id, self.name)
            self._closed = True
            self._writer.transport.abort()

    async def room(self) -> None:
        """Return when little waits in the outbox, or nothing will any more."""
        while self._outbox_bytes > ROOM_BYTES and not self._closed:
            await self._drained.wait()

    async def request(self, method: str, params: dict[str, Any]) -> Any:
        """Ask the client. Cancelling withdraws the question with `$/cancel_request`.

        Raises `RequestError` for an error response, `ConnectionError` when the client is gone.
        """
        if self._closed:
            raise ConnectionError("the client is gone")
        self._asked += 1
        request_id = f"p{self._asked}"
        answer = self._answers[request_id] = asyncio.get_running_loop().create_future()
        await self.send({"jsonrpc": "2.0", "id": request_id, "method": method, "params": params})
        try:
            return await answer
        except asyncio.CancelledError:
            await self.notify("$/cancel_request", {"requestId": request_id})
            raise
        finally:
            del self._answers[request_id]

    async def notify(self, method: str, params: dict[str, Any]) -> None:
        """Tell the client something that belongs to no session."""
        await self.send({"jsonrpc": "2.0", "method": method, "params": params})

    async def _send_outbox(self) -> None:
        while True:
            await self._filled.wait()
            self._filled.clear()
            lines, latest = b"".join(self._outbox), b"".join(self._latest.values())
            self._outbox.clear()
            self._latest.clear()
            self._writer.write(lines + latest)
            try:
                await self._writer.drain()
            except OSError:
                self._closed = True
            self._outbox_bytes -= len(lines)
            if not self._outbox or self._closed:
                self._drained.set()


class _Guarded:
    """The router, with errors made safe for strangers."""

    def __init__(self, router: MessageRouter, connection: ClientConnection) -> None:
        self._router = router
        self._connection = connection

    async def __call__(self, method: str, params: Any | None, is_notification: bool) -> Any:
        try:
            work = self._router(method, params if params is not None else {}, is_notification)
            return await self._connection.handle(work)
        except RequestError as error:
            if is_notification:
                return None  # an unknown or refused notification is ignored
            if error.code == wire.METHOD_NOT_FOUND:
                raise RequestError(error.code, f"There is no method {method[:80]}.") from None
            raise
        except ValidationError as error:
            where = [{"at": ".".join(map(str, e["loc"])), "problem": e["type"]} for e in error.errors()[:10]]
            raise RequestError.invalid_params({"errors": where}) from None
        except Exception as error:
            reference = uuid.uuid4().hex[:8]
            log.exception("%s failed (reference %s)", method, reference)
            message = f"Something went wrong inside the agent. Its log says what, under {reference}."
            raise RequestError(wire.INTERNAL_ERROR, message) from error


def _with_wrapped_meta(body: dict[str, Any]) -> dict[str, Any]:
    params = body.get("params")
    if isinstance(params, dict) and "_meta" in params:
        meta = params["_meta"]
        wrapped = {META_ARGUMENT: meta} if isinstance(meta, dict) else {}
        return body | {"params": params | {"_meta": wrapped}}
    return body
