"""Permission requests to people: who is asked whether a tool call may run, and which answer counts.

Everyone attached to the session who may approve is asked, and the first valid answer counts. Only an `allow_*` option
that was offered allows the call. A rejection, an invalid answer, no answer in time, and nobody to ask all refuse it. As
soon as one person has answered, the request is withdrawn from the others. Where two people have to agree, only somebody
else than the asker is asked, and tokens prove both. Whether people are asked at all is decided in `permission.py`.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any, Literal, Protocol

from acp.schema import RequestPermissionResponse
from pydantic import ValidationError

from backend import meta as keys
from backend.identity import Identity

log = logging.getLogger(__name__)

GRACE_S = 10.0
"""A person who disconnected less than so long ago is expected back: reloading a web page takes a few seconds."""

Reason = Literal["selected", "remembered", "timeout", "nobody"]

OPTION_KINDS = ("allow_once", "allow_always", "reject_once", "reject_always")
_ONCE = ("allow_once", "reject_once")


class Approver(Protocol):
    """A client connection that can be sent requests."""

    @property
    def name(self) -> str:
        """The name of the person, for people."""

    @property
    def identity(self) -> Identity | None:
        """Who is logged in at this moment; None for nobody."""

    @property
    def may_approve(self) -> bool:
        """Whether this person's answer counts at this moment."""

    async def request(self, method: str, params: dict[str, Any]) -> Any:
        """Send a request and return its result. Cancelling this withdraws the request from the client.

        Raises `ConnectionError` when the connection is lost, and another exception for an error response.
        """


@dataclass(frozen=True)
class Outcome:
    """How a permission request ended. `allowed` is true only where an `allow_*` option was chosen, `option` is the
    chosen option, and `by` the name of the person who chose it. `fingerprint` is that of the tool for which the option
    counts for the rest of the session; None where it counts for one call. `identity` is that of the person `by`."""

    allowed: bool
    reason: Reason
    option: str | None = None
    by: str | None = None
    fingerprint: str | None = None
    identity: Identity | None = field(default=None, compare=False)

    @property
    def refusal(self) -> str:
        """Why the call was not allowed, in words for people and the model."""
        match self.reason:
            case "selected":
                return f"refused by {self.by}"
            case "remembered":
                return "refused: somebody chose to refuse this for the whole session"
            case "timeout":
                return "refused: nobody answered in time"
            case "nobody":
                return "refused: nobody is there who may allow it"


def may_answer(person: Identity | None, other_than: Identity | None) -> bool:
    """Whether `person` may answer a request. `other_than` is the asker where two people have to agree, else None."""
    return other_than is None or (person is not None and person.is_somebody_else(other_than))


def options(subject: str, *, once: bool = False) -> list[dict[str, str]]:
    """The four options of a permission request, named for people; with `once`, only the two that count for this call.

    `subject` names what the tool does, for instance "speech".
    """
    names = ("Allow", f"Allow {subject} in this session", "Don't", f"Never {subject} in this session")
    all_four = zip(OPTION_KINDS, names, strict=True)
    return [{"optionId": k, "name": n, "kind": k} for k, n in all_four if k in _ONCE or not once]


def read_answer(result: Any, offered: Collection[str] = OPTION_KINDS) -> str | None:
    """The option that a client's answer selects, or None where the answer is invalid or the option was not offered."""
    try:
        outcome = RequestPermissionResponse.model_validate(result).outcome
    except ValidationError:
        return None
    option = getattr(outcome, "option_id", None)
    return option if option in offered else None


@dataclass(eq=False)
class PermissionRequest:
    """One pending permission request. `other_than` is the asker where two people have to agree, so that only somebody
    else may answer; None where everybody may who approves."""

    params: dict[str, Any]
    outcome: asyncio.Future[Outcome]
    other_than: Identity | None = None
    sent: dict[Approver, asyncio.Task[None]] = field(default_factory=dict)
    """The connections that the request was sent to and that have not answered it."""


class AbsentApprovers:
    """People who may approve, are not attached to a session, and may still attach to it.

    These are the people who disconnected less than `grace_s` seconds ago, and those who are attached to other sessions
    only: the telemetry shows them which session controls the robot. All sessions share one instance, because a page
    that is reloaded may open any session. `everybody` returns the connections that are attached to any session.
    """

    def __init__(self, everybody: Callable[[], Iterable[Approver]] = tuple, grace_s: float = GRACE_S) -> None:
        self._everybody = everybody
        self._grace_s = grace_s
        self._disconnected: dict[str, tuple[Identity, asyncio.TimerHandle]] = {}
        """People who disconnected a moment ago, and the timer that ends their time to return."""
        self.waiting: set[PermissionRequests] = set()
        """The sessions that have a pending request."""

    def may_attach(self, attached: Collection[Approver], other_than: Identity | None) -> bool:
        """Whether somebody is not among `attached` and may still attach whose answer would count: see `may_answer`."""
        elsewhere = (person.identity for person in self._everybody() if person.may_approve and person not in attached)
        expected = (who for who, _ in self._disconnected.values())
        return any(may_answer(who, other_than) for who in (*expected, *elsewhere))

    def disconnected(self, approver: Approver) -> None:
        """Expect this person back for `grace_s` seconds, provided that their answer would still count."""
        self.returned(approver)
        if (who := approver.identity) and approver.may_approve:
            timer = asyncio.get_running_loop().call_later(self._grace_s, self._did_not_return, who.person)
            self._disconnected[who.person] = who, timer
        else:
            self._refuse_unanswerable()

    def returned(self, approver: Approver) -> None:
        """Stop expecting this person back."""
        if (who := approver.identity) and (expected := self._disconnected.pop(who.person, None)):
            expected[1].cancel()

    def _did_not_return(self, person: str) -> None:
        del self._disconnected[person]
        self._refuse_unanswerable()

    def _refuse_unanswerable(self) -> None:
        for requests in self.waiting:
            requests.refuse_unanswerable()


class PermissionRequests:
    """The pending permission requests of one session, and the attached connections that may answer them."""

    def __init__(
        self, timeout_s: float, spawn: Callable[[Any], asyncio.Task[None]], absent: AbsentApprovers | None = None
    ) -> None:
        """`timeout_s` is the time for an answer in seconds; `spawn` starts a task and keeps it referenced."""
        self.timeout_s = timeout_s
        self._spawn = spawn
        self._absent = absent or AbsentApprovers()
        self._pending: list[PermissionRequest] = []
        self._approvers: list[Approver] = []

    def attach(self, approver: Approver) -> None:
        """Send the pending requests to a connection, and every later one."""
        if approver in self._approvers:
            return
        self._approvers.append(approver)
        self._absent.returned(approver)
        for request in self._pending:
            self._send(request, approver)

    def detach(self, approver: Approver, *, reattaching: bool = False) -> None:
        """Send no more requests to a connection, and withdraw the pending ones from it.

        A request that is then pending with nobody is refused at once where this person may no longer approve, and
        after the grace period where they may. With `reattaching`, the caller attaches the same connection again, so
        nothing is refused.
        """
        if approver not in self._approvers:
            return
        self._approvers.remove(approver)
        for request in self._pending:
            if task := request.sent.pop(approver, None):
                task.cancel()
        if not reattaching:
            self._absent.disconnected(approver)

    def refuse_unanswerable(self) -> None:
        """Refuse every request that is pending with nobody and that nobody may still attach to answer.

        An attached person with whom it is no longer pending has given an answer that does not count.
        """
        for request in self._pending:
            answerable = request.sent or self._absent.may_attach(self._approvers, request.other_than)
            if not answerable and not request.outcome.done():
                request.outcome.set_result(Outcome(False, "nobody"))

    def has_approver(self, other_than: Identity | None = None) -> bool:
        """Whether somebody is attached to the session, or may still attach, whose answer counts: see `may_answer`."""
        attached = self._approvers
        counts = any(may_answer(person.identity, other_than) for person in attached)
        return counts or self._absent.may_attach(attached, other_than)

    async def ask(
        self,
        session_id: str,
        tool_call: dict[str, Any],
        subject: str,
        asker: str,
        other_than: Identity | None = None,
        preview: dict[str, Any] | None = None,
    ) -> Outcome:
        """Ask everyone who may approve, and return how the request ended.

        With `other_than`, which is the asker, two people have to agree on this one call: only somebody else may answer
        (see `may_answer`), and the options that count for the whole session are not offered. `subject` names what an
        "always" would count for; `preview` is the `_meta` that tells what the call would do. The request ends with the
        first valid answer, at the latest after `timeout_s` seconds. Cancelling this withdraws the request from
        everyone.
        """
        if not self.has_approver(other_than):
            return Outcome(False, "nobody")
        expires = datetime.now(UTC) + timedelta(seconds=self.timeout_s)
        meta: dict[str, Any] = {
            keys.EXPIRES: expires.isoformat(),
            keys.TIMEOUT_S: self.timeout_s,
            keys.ASKER: asker,
            keys.SUBJECT: subject,
        }
        if preview is not None:
            meta[keys.PREVIEW] = preview
        params = {
            "sessionId": session_id,
            "toolCall": tool_call,
            "options": options(subject, once=other_than is not None),
            "_meta": meta,
        }
        return await self._outcome(PermissionRequest(params, asyncio.get_running_loop().create_future(), other_than))

    async def _outcome(self, request: PermissionRequest) -> Outcome:
        self._pending.append(request)
        self._absent.waiting.add(self)
        for approver in self._approvers:
            self._send(request, approver)
        try:
            async with asyncio.timeout(self.timeout_s):
                return await request.outcome
        except TimeoutError:
            return Outcome(False, "timeout")
        finally:
            self._pending.remove(request)
            if not self._pending:
                self._absent.waiting.discard(self)
            for task in request.sent.values():
                task.cancel()

    def _send(self, request: PermissionRequest, approver: Approver) -> None:
        if not may_answer(approver.identity, request.other_than):
            return
        request.sent[approver] = self._spawn(self._await_answer(request, approver))

    async def _await_answer(self, request: PermissionRequest, approver: Approver) -> None:
        try:
            answer = await approver.request("session/request_permission", request.params)
            # The rights, and the person, can have changed since the request was sent.
            offered = [option["optionId"] for option in request.params["options"]]
            counts = approver.may_approve and may_answer(approver.identity, request.other_than)
            option = read_answer(answer, offered) if counts else None
            who = approver.identity
        except ConnectionError:
            if request.sent.pop(approver, None) and approver in self._approvers:
                self._absent.disconnected(approver)
            return
        except Exception as error:  # an error response, which must not end the turn
            log.info("no answer from %s: %s", approver.name, type(error).__name__)
            option = who = None
        if request.outcome.done():
            return
        if option is not None:
            allowed = option.startswith("allow_")
            request.outcome.set_result(Outcome(allowed, "selected", option, approver.name, identity=who))
            return
        request.sent.pop(approver, None)
        self.refuse_unanswerable()
