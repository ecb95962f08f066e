"""The messages of one client on their way to their handlers, and the answers on their way back.

Handlers begin in the order in which their messages arrived. Every request gets one answer, a notification none. A
request beyond the login's limits is answered with an error, a notification beyond them is dropped; never one that
cancels or stops. No text of an exception that this agent did not write for people leaves through here.
"""

from __future__ import annotations

import asyncio
import logging
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import orjson
from acp.exceptions import RequestError
from acp.router import MessageRouter
from pydantic import BaseModel, ValidationError
from sqlalchemy.exc import SQLAlchemyError

from backend import wire
from backend.agent.acp.request_limits import Account, is_urgent
from backend.agent.sessions.database import StoreError
from backend.agent.sessions.store import SILENT

MAX_URGENT = 16
"""So many cancels and stops of one connection are carried out at once. Until one is done, it is not read further."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class AnswerThen:
    """What a handler returns when something has to follow its answer on the wire: `then` is called right behind it."""

    answer: object
    then: Callable[[], None]


@dataclass(eq=False)
class _Request:
    """A request that is being handled."""

    frame: wire.Frame
    task: asyncio.Task[Any]
    cancelled_by_client: bool = False


class Dispatcher:
    """Runs the handlers of one connection as tasks of `handlers`; `send` queues an answer.

    `account` returns what the login at the connection asks for at present.
    """

    def __init__(
        self,
        router: MessageRouter,
        send: Callable[[bytes], None],
        handlers: asyncio.TaskGroup,
        account: Callable[[], Account],
    ) -> None:
        self._router = router
        self._send = send
        self._handlers = handlers
        self._account = account
        self._running: list[_Request] = []
        self._limited = 0
        """Requests and notifications that are being handled, but for the urgent ones."""
        self._urgent = asyncio.Semaphore(MAX_URGENT)
        self._is_first = True
        """Whether no message has come yet: the first is `initialize`."""

    async def begin(self, frame: wire.Frame) -> None:
        """Begin to handle a message. Returns when its handler waits for the first time, or is done.

        So no handler begins before those of earlier messages: a cancel finds the prompt that it is for. And every
        message that was read has begun when the connection ends: a cancel with which the client leaves counts.
        """
        to_handle = self._cancel_request(frame) if frame.method == "$/cancel_request" else frame
        if to_handle is None:
            return
        done: Callable[[], None]
        if is_urgent(to_handle) or self._is_first:
            self._is_first = False
            await self._urgent.acquire()
            done = self._urgent.release
        else:
            account = self._account()
            try:
                account.charge(self._limited)
            except RequestError as error:
                if to_handle.kind == "request":
                    self._send(_frame(to_handle.id, "error", error.to_error_obj()))
                return
            done = self._occupy(account)
        begun = asyncio.Event()
        work = self._answer(to_handle, begun) if to_handle.kind == "request" else self._carry_out(to_handle, begun)
        task = self._handlers.create_task(work, name=f"handler of {to_handle.method}")
        task.add_done_callback(lambda _: done())
        await begun.wait()

    def _occupy(self, account: Account) -> Callable[[], None]:
        """Count one more message that is being handled; the returned function counts it no more."""
        self._limited += 1
        account.pending += 1

        def done() -> None:
            self._limited -= 1
            account.pending -= 1

        return done

    def cancel_requests(self) -> None:
        """Cancel the handlers of all requests: nobody is left to be answered. Notifications are carried out."""
        for request in self._running:
            request.task.cancel()

    def _cancel_request(self, frame: wire.Frame) -> wire.Frame | None:
        """Carry out `$/cancel_request`. The cancelled request is answered all the same, with the code -32800.

        A prompt is answered when its turn has ended, so for a prompt this returns the `session/cancel` that ends it.
        """
        if frame.kind == "request":
            return frame  # the protocol has no such request, and the router answers so
        request_id = (frame.body.get("params") or {}).get("requestId")
        if request_id is None or not wire.valid_id(request_id):
            return None
        request = next((r for r in reversed(self._running) if r.frame.id == request_id), None)
        if request is None:
            return None  # it has been answered already
        if request.frame.method == "session/prompt":
            session_id = (request.frame.body.get("params") or {}).get("sessionId")
            body = {"jsonrpc": "2.0", "method": "session/cancel", "params": {"sessionId": session_id}}
            return wire.Frame("notification", "session/cancel", None, body, b"")
        request.cancelled_by_client = True
        request.task.cancel()
        return None

    async def _carry_out(self, notification: wire.Frame, begun: asyncio.Event) -> None:
        begun.set()  # `begin` goes on when this task waits or ends: until then nothing else runs
        try:
            await self._router(str(notification.method), notification.body.get("params") or {}, True)
        except (RequestError, ValidationError):
            pass  # an unknown, refused or malformed notification is ignored
        except Exception:
            log.exception("the notification %s failed", notification.method)

    async def _answer(self, frame: wire.Frame, begun: asyncio.Event) -> None:
        begun.set()  # as above
        task = asyncio.current_task()
        assert task is not None  # noqa: S101 - a coroutine always runs in a task
        request = _Request(frame, task)
        self._running.append(request)
        then: Callable[[], None] | None = None
        try:
            answer: object = await self._router(str(frame.method), frame.body.get("params") or {}, False)
            if isinstance(answer, AnswerThen):
                then, answer = answer.then, answer.answer
            reply = _within_limit(frame.id, _frame(frame.id, "result", _plain(answer)))
        except asyncio.CancelledError:
            if not request.cancelled_by_client:
                raise
            reply = _frame(frame.id, "error", RequestError(wire.CANCELLED, "Cancelled.").to_error_obj())
        except Exception as error:
            reply = _frame(frame.id, "error", _error_for_strangers(error, str(frame.method)).to_error_obj())
        finally:
            self._running.remove(request)
        self._send(reply)
        if then is not None:
            then()


def _plain(answer: object) -> object:
    if isinstance(answer, BaseModel):
        return answer.model_dump(mode="json", by_alias=True, exclude_none=True, exclude_unset=True)
    return answer


def _frame(request_id: wire.RequestId, kind: str, content: object) -> bytes:
    return orjson.dumps({"jsonrpc": "2.0", "id": request_id, kind: content}, option=orjson.OPT_APPEND_NEWLINE)


def database_away(text: str) -> RequestError:
    """The error for what needs the database while it cannot be used. Clients know it by its `data`."""
    return RequestError(wire.INTERNAL_ERROR, text, {"unavailable": "database"})


def after_stop(stopped: str, error: Exception) -> RequestError:
    """The error for a stop whose session cannot be opened. The stop was made all the same, and comes first."""
    told = _error_for_strangers(error, "session/prompt")
    return RequestError(told.code, f"{stopped} {told}", told.data)


def _within_limit(request_id: wire.RequestId, reply: bytes) -> bytes:
    """The reply, or an error in place of one that no client and no bridge would take."""
    if len(reply) - 1 <= wire.MAX_FRAME_BYTES:
        return reply
    log.error("an answer of %d bytes is larger than a message may be; the client gets an error", len(reply))
    text = f"The answer has {len(reply)} bytes, and a message at most {wire.MAX_FRAME_BYTES}. Ask for less of it."
    return wire.error_frame(request_id, wire.INTERNAL_ERROR, text) + b"\n"


def _error_for_strangers(error: Exception, method: str) -> RequestError:
    """The error that a client may see. For an unexpected exception it contains only a reference into the log."""
    if isinstance(error, RequestError):
        if error.code == wire.METHOD_NOT_FOUND:
            return RequestError(error.code, f"There is no method {method[:80]}.")
        return error
    if isinstance(error, ValidationError):
        problems = [{"at": ".".join(map(str, e["loc"])), "problem": e["type"]} for e in error.errors()[:10]]
        return RequestError.invalid_params({"errors": problems})
    if isinstance(error, StoreError):
        return database_away(str(error))
    if isinstance(error, SQLAlchemyError):
        log.debug("%s failed", method, exc_info=error)  # the journal says once that the database is away
        return database_away(SILENT)
    reference = uuid.uuid4().hex[:8]
    log.error("%s failed (reference %s)", method, reference, exc_info=error)
    message = f"Something went wrong inside the agent. Its log says what, under {reference}."
    return RequestError(wire.INTERNAL_ERROR, message)
