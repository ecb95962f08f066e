"""Questions to people: may the robot do this? Everyone who may approve is asked; the first valid answer counts.

Only an `allow_*` option that was offered allows. A rejection, an answer that makes no sense, no answer in
time, nobody to ask: all of these refuse. The rest of the askers see the question withdrawn.
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

log = logging.getLogger(__name__)

GRACE_S = 10.0
"""How long somebody who has gone is expected back, as from a page that is loaded again, before nobody is there."""

Reason = Literal["selected", "remembered", "timeout", "nobody"]

OPTION_KINDS = ("allow_once", "allow_always", "reject_once", "reject_always")
_ONCE = ("allow_once", "reject_once")


class Approver(Protocol):
    """A connection that can be asked. `request` ends with the client's result, and raises on an error or a
    lost connection; cancelling it withdraws the question at the client."""

    @property
    def name(self) -> str:
        """Who this is, for people."""

    @property
    def may_approve(self) -> bool:
        """Whether this person's answer counts, at this moment."""

    async def request(self, method: str, params: dict[str, Any]) -> Any: ...


@dataclass(frozen=True)
class Verdict:
    """How a question ended. `allowed` is true only for a chosen `allow_*` option; `by` is who chose."""

    allowed: bool
    reason: Reason
    option: str | None = None
    by: str | None = None

    @property
    def remembered(self) -> bool:
        """Whether it is to count for this tool for the rest of the session."""
        return self.reason == "selected" and self.option in ("allow_always", "reject_always")

    @property
    def refusal(self) -> str:
        """Why it was not allowed, in words for people and the model."""
        match self.reason:
            case "selected":
                return f"refused by {self.by}"
            case "remembered":
                return "refused: somebody chose to refuse this for the whole session"
            case "timeout":
                return "refused: nobody answered in time"
            case "nobody":
                return "refused: nobody is there who may allow it"


def options(subject: str, *, once: bool = False) -> list[dict[str, str]]:
    """The four answers, in words for people, or the two that count `once`; `subject` is what the tool does, as in
    "speech"."""
    names = ("Allow", f"Allow {subject} in this session", "Don't", f"Never {subject} in this session")
    all_four = zip(OPTION_KINDS, names, strict=True)
    return [{"optionId": k, "name": n, "kind": k} for k, n in all_four if k in _ONCE or not once]


def read_answer(result: Any, offered: Collection[str] = OPTION_KINDS) -> str | None:
    """The option that a client's answer chose, if it is one of those offered; else None, which refuses."""
    try:
        outcome = RequestPermissionResponse.model_validate(result).outcome
    except ValidationError:
        return None
    option = getattr(outcome, "option_id", None)
    return option if option in offered else None


@dataclass(eq=False)
class Question:
    """One pending question and the clients that see it."""

    params: dict[str, Any]
    verdict: asyncio.Future[Verdict]
    not_by: str | None = None
    asked: dict[Approver, asyncio.Task[None]] = field(default_factory=dict)


class Audience:
    """Who may come to a desk without being attached to it: those who have gone a moment ago, and those who watch other
    sessions, for telemetry tells them whose turn controls the robot. One for all desks: a page that is loaded again may
    come to any of them. `everybody` tells who watches anything."""

    def __init__(self, everybody: Callable[[], Iterable[Approver]] = tuple) -> None:
        self._everybody = everybody
        self._expected: dict[str, asyncio.TimerHandle] = {}
        """Those who have gone a moment ago, by name, and when they are expected no longer."""
        self.asking: set[PermissionDesk] = set()
        """Desks with a question."""

    def may_come(self, here: Collection[Approver], not_by: str | None) -> bool:
        """Whether somebody other than `not_by` who may approve is not `here`, and may come."""
        elsewhere = (person.name for person in self._everybody() if person.may_approve and person not in here)
        return any(name != not_by for name in (*self._expected, *elsewhere))

    def gone(self, approver: Approver) -> None:
        """Expect somebody back for a while, if they could still answer."""
        self.back(approver)
        if approver.may_approve:
            loop = asyncio.get_running_loop()
            self._expected[approver.name] = loop.call_later(GRACE_S, self._expect_no_longer, approver.name)
        else:
            self._judge()

    def back(self, approver: Approver) -> None:
        """Somebody need not be expected any longer."""
        if expected := self._expected.pop(approver.name, None):
            expected.cancel()

    def _expect_no_longer(self, name: str) -> None:
        del self._expected[name]
        self._judge()

    def _judge(self) -> None:
        for desk in self.asking:
            desk.judge()


class PermissionDesk:
    """The pending questions of one session."""

    def __init__(
        self, timeout_s: float, spawn: Callable[[Any], asyncio.Task[None]], audience: Audience | None = None
    ) -> None:
        self.timeout_s = timeout_s
        self._spawn = spawn
        self._audience = audience or Audience()
        self._pending: list[Question] = []
        self._approvers: list[Approver] = []

    def attach(self, approver: Approver) -> None:
        """Someone who may approve has come: show what is pending, and ask from now on."""
        if approver in self._approvers:
            return
        self._approvers.append(approver)
        self._audience.back(approver)
        for question in self._pending:
            self._put(question, approver)

    def detach(self, approver: Approver, *, returns: bool = False) -> None:
        """Someone has gone; a question that nobody sees any more is refused: if they are not back soon, at once if it
        is their right that has gone, and not at all because of one who `returns` for sure."""
        if approver not in self._approvers:
            return
        self._approvers.remove(approver)
        for question in self._pending:
            if task := question.asked.pop(approver, None):
                task.cancel()
        if not returns:
            self._audience.gone(approver)

    def judge(self) -> None:
        """Refuse the questions that nobody sees and nobody may come to. Whoever is here and not asked has given an
        answer that does not count."""
        for question in self._pending:
            seen = question.asked or self._audience.may_come(self._approvers, question.not_by)
            if not seen and not question.verdict.done():
                question.verdict.set_result(Verdict(False, "nobody"))

    def attended(self, not_by: str | None = None) -> bool:
        """Whether a question has a chance: somebody other than `not_by` who may approve is attached, or may come."""
        here = self._approvers
        return any(approver.name != not_by for approver in here) or self._audience.may_come(here, not_by)

    async def ask(
        self,
        session_id: str,
        tool_call: dict[str, Any],
        subject: str,
        asker: str,
        not_by: str | None = None,
        preview: dict[str, Any] | None = None,
    ) -> Verdict:
        """Ask everyone who may approve but `not_by`, and wait for the first valid answer, at most for the time limit.

        With `not_by`, two people agree on this one call: no answer is offered that would count for later ones.
        `subject` names what an "always" would count for, `preview` tells what would happen.
        Cancelling the call withdraws the question everywhere.
        """
        if not self.attended(not_by):
            return Verdict(False, "nobody")
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
            "options": options(subject, once=not_by is not None),
            "_meta": meta,
        }
        question = Question(params, asyncio.get_running_loop().create_future(), not_by)
        self._pending.append(question)
        self._audience.asking.add(self)
        for approver in self._approvers:
            self._put(question, approver)
        try:
            async with asyncio.timeout(self.timeout_s):
                return await question.verdict
        except TimeoutError:
            return Verdict(False, "timeout")
        finally:
            self._pending.remove(question)
            if not self._pending:
                self._audience.asking.discard(self)
            for task in question.asked.values():
                task.cancel()

    def _put(self, question: Question, approver: Approver) -> None:
        if approver.name == question.not_by:
            return
        question.asked[approver] = self._spawn(self._put_to(question, approver))

    async def _put_to(self, question: Question, approver: Approver) -> None:
        try:
            answer = await approver.request("session/request_permission", question.params)
            # What somebody may do can have changed since the question was put.
            offered = [option["optionId"] for option in question.params["options"]]
            option = read_answer(answer, offered) if approver.may_approve else None
        except ConnectionError:
            if question.asked.pop(approver, None) and approver in self._approvers:
                self._audience.gone(approver)
            return
        except Exception as error:  # an error response; it must not break the turn
            log.info("no answer from %s: %s", approver.name, type(error).__name__)
            option = None
        if question.verdict.done():
            return
        if option is not None:
            allowed = option.startswith("allow_")
            question.verdict.set_result(Verdict(allowed, "selected", option, approver.name))
            return
        question.asked.pop(approver, None)
        self.judge()
