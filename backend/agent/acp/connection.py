"""One client connection of the agent: checked frames in, one ordered outbox out.

Everything that goes to the client, answers, questions and the events of its sessions, passes the one outbox, so
their order on the wire is the order in which they were made. A client that does not read is cut off; it never makes
anybody wait.
"""

from __future__ import annotations

import asyncio
import logging
import uuid
from collections.abc import Awaitable, Callable
from typing import Any

import orjson
from acp.exceptions import RequestError
from acp.router import MessageRouter

from backend import meta as keys
from backend import wire
from backend.agent.acp.dispatch import Dispatcher
from backend.agent.acp.outbox import Outbox
from backend.agent.acp.request_limits import Account, ReadingPace, RequestLimits
from backend.connections_before_login import ConnectionsBeforeLogin
from backend.identity import Identity, Right

log = logging.getLogger(__name__)

DISMISS_S = 1.0
"""How long a client whose login has ended may take to read the messages that wait for it."""


class ClientConnection:
    """An ACP connection over an NDJSON stream, and a session's listener.

    While it is not logged in it counts in `before_login`, and its messages have to be short and the first one has to
    come soon; `before_login` is None for a client that cannot be a stranger.
    """

    def __init__(
        self,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
        trusted: Callable[[], Awaitable[bool]],
        max_outbox_bytes: int,
        limits: RequestLimits | None = None,
        before_login: ConnectionsBeforeLogin | None = None,
    ) -> None:
        """`trusted` says whether this client is let in without a token. It is asked once, at a client without one."""
        self.id = uuid.uuid4().hex[:8]
        self.trusted = False
        """Set before `initialize` is handled: whether the client is let in without a token."""
        self.initialized = False
        """Set when the first message was a request to initialize."""
        self.client_capabilities: dict[str, Any] = {}
        """As the client gave them in `initialize`."""
        self.folders: dict[str, str] = {}
        """Session id -> the folder that this client named when it opened the session."""
        self._ask_trusted = trusted
        self._reader = reader
        self._outbox = Outbox(writer)
        self._max_outbox_bytes = max_outbox_bytes
        self._limits = limits or RequestLimits()
        self._own_account = self._limits.new()
        self._pace = ReadingPace()
        self._before_login = before_login
        self.address: str | None = (writer.get_extra_info("peername") or [None])[0] or None
        """The address of the client; None on stdio."""
        self._identity: Identity | None = None
        self._count_before_login()
        self._questions_asked = 0
        self._answers: dict[str, asyncio.Future[Any]] = {}
        """The open questions to the client, by request id."""

    @property
    def identity(self) -> Identity | None:
        """Set by `initialize` or `authenticate`; None before, after `logout`, and once the login has ended."""
        return self._identity

    @identity.setter
    def identity(self, identity: Identity | None) -> None:
        self._identity = identity
        self._count_before_login()

    @property
    def account(self) -> Account:
        """What the login of this connection asks for, over all its connections."""
        return (self._identity and self._limits.of(self._identity)) or self._own_account

    @property
    def name(self) -> str:
        """The name of the person at this connection, for people."""
        return self.identity.name if self.identity else "somebody"

    @property
    def person(self) -> str:
        """Who is at this connection, for comparisons."""
        return self.identity.person if self.identity else f"connection:{self.id}"

    @property
    def may_approve(self) -> bool:
        """Whether permission questions go to this connection."""
        who = self.identity
        return who is not None and not who.expired and who.may(Right.APPROVE)

    @property
    def can_write_files(self) -> bool:
        """Whether the client said that it writes files for the agent."""
        return bool((self.client_capabilities.get("fs") or {}).get("writeTextFile"))

    @property
    def can_show_forms(self) -> bool:
        """Whether the client said that it shows forms."""
        return isinstance((self.client_capabilities.get("elicitation") or {}).get("form"), dict)

    def folder_of(self, session_id: str) -> str | None:
        """The folder that this client named when it opened the session; None where it has not."""
        return self.folders.get(session_id)

    @property
    def wants_people(self) -> bool:
        """Whether the client asked for the list of connected people."""
        return (self.client_capabilities.get("_meta") or {}).get(keys.PEOPLE) is True

    async def serve(self, router: MessageRouter) -> None:
        """Handle messages until the client goes away. When this returns, no handler runs any more."""
        try:
            async with asyncio.TaskGroup() as tasks:
                sending = tasks.create_task(self._outbox.send(), name=f"outbox {self.id}")
                await self._handle_messages(router)
                sending.cancel()
        finally:
            self._outbox.finish()

    def _count_before_login(self) -> None:
        if self._before_login is None:
            return
        self._before_login.remove(self)
        if self._identity is None:
            self._before_login.add(self, self.address, self._outbox.abort)

    async def _handle_messages(self, router: MessageRouter) -> None:
        async with asyncio.TaskGroup() as handlers:
            dispatcher = Dispatcher(router, self.deliver, handlers, lambda: self.account)
            try:
                while (frame := await self._next_frame()) is not None:
                    if frame.kind == "response":
                        self._accept_answer(frame)
                    else:
                        await dispatcher.begin(frame)
            finally:
                self._outbox.close()
                for answer in self._answers.values():
                    if not answer.done():
                        answer.set_exception(ConnectionError("the client is gone"))
            dispatcher.cancel_requests()

    async def _next_frame(self) -> wire.Frame | None:
        """The next checked message; None at the end. A bad frame is answered here, and reading goes on."""
        while not self._outbox.closed:
            try:
                line = await self._read_line()
                if line is None:
                    return None
                self._pace.count(self.account, len(line))
                frame = wire.check(line)
            except wire.BadFrame as bad:
                if not self.initialized:
                    return None  # no ACP client: a web page, a port scan
                if bad.reply is not None:
                    self.deliver(bad.reply + b"\n")
                continue
            except (OSError, TimeoutError):
                return None
            if not self.initialized:
                if (frame.kind, frame.method) != ("request", "initialize"):
                    if (frame.kind, frame.method) == ("request", wire.HEALTH):
                        self._send({"jsonrpc": "2.0", "id": frame.id, "result": {}})
                    return None
                # Here and not in the handler, which would let the messages behind this one begin while it waits.
                self.trusted = not _has_token(frame) and await self._ask_trusted()
                self.initialized = True
            return frame
        return None

    async def _read_line(self) -> bytes | None:
        """The next line; a short one before the login. Raises `TimeoutError` where the first does not come in time."""
        await self._pace.wait()
        who = self._identity
        if self._before_login is None or who is not None:
            short = who is not None and not who.may(Right.APPROVE)
            return await wire.read_line(self._reader, wire.MAX_SHORT_FRAME_BYTES if short else wire.MAX_FRAME_BYTES)
        limit = self._limits.settings.max_bytes_before_login
        if self.initialized:
            return await wire.read_line(self._reader, limit)
        async with asyncio.timeout(self._limits.settings.initialize_timeout):
            return await wire.read_line(self._reader, limit, skip=False)

    def _accept_answer(self, frame: wire.Frame) -> None:
        answer = self._answers.get(str(frame.id))
        if answer is None or answer.done():
            return  # a second answer, or one to a question that was withdrawn
        if "error" in frame.body:
            answer.set_exception(RequestError(wire.INTERNAL_ERROR, "The client answered with an error."))
        else:
            answer.set_result(frame.body["result"])

    async def request(self, method: str, params: dict[str, Any]) -> Any:
        """Ask the client. Cancelling withdraws the question with `$/cancel_request`.

        Raises `RequestError` for an error response, `ConnectionError` when the client is gone or its login has ended.
        """
        if self._outbox.closed:
            raise ConnectionError("the client is gone")
        self._questions_asked += 1
        request_id = f"p{self._questions_asked}"
        answer = self._answers[request_id] = asyncio.get_running_loop().create_future()
        self._send({"jsonrpc": "2.0", "id": request_id, "method": method, "params": params})
        try:
            return await answer
        except asyncio.CancelledError:
            self._withdraw(request_id)
            raise
        finally:
            del self._answers[request_id]

    def _withdraw(self, request_id: str) -> None:
        self._send({"jsonrpc": "2.0", "method": "$/cancel_request", "params": {"requestId": request_id}})

    def _send(self, message: dict[str, Any]) -> None:
        self.deliver(orjson.dumps(message, option=orjson.OPT_APPEND_NEWLINE))

    async def dismiss(self) -> None:
        """End the login: withdraw the open questions and forget the identity.

        Returns when the client has had `DISMISS_S` to read the messages that wait for it; then it is cut off.
        """
        self.identity = None
        for request_id, answer in self._answers.items():
            if not answer.done():
                answer.set_exception(ConnectionError("the login is over"))
                self._withdraw(request_id)
        try:
            async with asyncio.timeout(DISMISS_S):
                await self._outbox.wait_until_sent()
        except TimeoutError:
            self._outbox.abort()

    # What a session needs of its listeners.

    def deliver(self, frame: bytes) -> None:
        """Queue a line; a client for which too much waits is cut off."""
        self._outbox.put(frame)
        self.cut_off_if_slow()

    def deliver_latest(self, method: str, frame: bytes) -> None:
        """Send a line soon, unless a newer one of its method comes first: for messages that are useless once old."""
        self._outbox.put_latest(method, frame)

    def cut_off_if_slow(self, held_bytes: int = 0) -> None:
        """Cut the client off when too much waits: here, and `held_bytes` that a session holds back for it."""
        if self._outbox.waiting_bytes + held_bytes > self._max_outbox_bytes and not self._outbox.closed:
            log.warning("connection %s of %s does not read; it is cut off", self.id, self.name)
            self._outbox.abort()

    async def wait_for_space(self) -> None:
        """Return when the outbox can take more of a long replay, or the connection is over."""
        await self._outbox.wait_for_space()


def _has_token(initialize: wire.Frame) -> bool:
    meta = (initialize.body.get("params") or {}).get("_meta")
    return isinstance(meta, dict) and keys.TOKEN in meta
