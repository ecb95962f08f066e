"""Only an `allow_*` option that was offered allows; everything else refuses."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from backend.agent.control.approvers import AbsentApprovers, Outcome, PermissionRequests, read_answer
from backend.identity import Identity, Role
from tests.processes import PATIENCE_S

CALL = {"toolCallId": "t1", "title": "Say aloud: “Hi.”"}


def chosen(option: str) -> dict[str, Any]:
    return {"outcome": {"outcome": "selected", "optionId": option}}


def proven(name: str) -> Identity:
    """Somebody with a token."""
    return Identity(name, Role.OPERATOR, token_id=f"token of {name}", subject=f"subject of {name}")


class Person:
    """Somebody who may approve, and answers when the test says so."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.identity: Identity | None = proven(name)
        self.asked: asyncio.Future[Any] | None = None
        self.offered: list[str] = []
        self.withdrawn = False
        self.may_approve = True

    def says(self, option: str) -> None:
        """Answer the question that was put."""
        assert self.asked is not None
        self.asked.set_result(chosen(option))

    async def request(self, method: str, params: dict[str, Any]) -> Any:
        assert method == "session/request_permission"
        assert params["toolCall"] == CALL
        self.offered = [option["optionId"] for option in params["options"]]
        self.asked = asyncio.get_running_loop().create_future()
        try:
            return await self.asked
        except asyncio.CancelledError:
            self.withdrawn = True
            raise


class Attached(PermissionRequests):
    """The permission requests of a session that some people are attached to."""

    def __init__(self, *people: Person, timeout_s: float = 60.0, absent: AbsentApprovers | None = None) -> None:
        self._tasks: list[asyncio.Task[None]] = []
        super().__init__(timeout_s, self._start, absent)
        for person in people:
            self.attach(person)

    def _start(self, work: Any) -> asyncio.Task[None]:
        self._tasks.append(asyncio.create_task(work))
        return self._tasks[-1]

    def asking(self, asker: str = "Visitor", *, four_eyes: bool = False) -> asyncio.Task[Outcome]:
        """A request whether the asker's call may run, which only somebody else may answer where it needs four eyes."""
        return asyncio.create_task(self.ask("s1", CALL, "speech", asker, proven(asker) if four_eyes else None))


@pytest.fixture
def ana() -> Person:
    return Person("Ana")


@pytest.fixture
def ben() -> Person:
    return Person("Ben")


async def asked(*people: Person) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while any(person.asked is None for person in people):
            await asyncio.sleep(0)


@pytest.mark.parametrize(
    ("option", "allowed"),
    [("allow_once", True), ("allow_always", True), ("reject_once", False), ("reject_always", False)],
)
async def test_the_chosen_option_counts_not_that_one_was_chosen(ana: Person, option: str, allowed: bool) -> None:
    question = Attached(ana).asking()
    await asked(ana)
    assert ana.asked is not None
    ana.asked.set_result(chosen(option))
    assert await question == Outcome(allowed, "selected", option, "Ana")


@pytest.mark.parametrize(
    "answer",
    [
        chosen("reject"),
        chosen("allow"),
        chosen("ALLOW_ONCE"),
        {"outcome": {"outcome": "cancelled"}},
        {"outcome": {"outcome": "selected"}},
        {"outcome": {"outcome": "allowed", "optionId": "allow_once"}},
        {"outcome": "allow_once"},
        {},
        None,
        [],
        "allow_once",
    ],
)
async def test_an_answer_that_is_none_of_those_offered_refuses(ana: Person, answer: Any) -> None:
    assert read_answer(answer) is None
    question = Attached(ana).asking()
    await asked(ana)
    assert ana.asked is not None
    ana.asked.set_result(answer)
    assert (await question).allowed is False


async def test_the_first_answer_counts_and_the_others_see_the_question_withdrawn(ana: Person, ben: Person) -> None:
    question = Attached(ana, ben).asking()
    await asked(ana, ben)
    ben.says("reject_once")
    assert (await question).by == "Ben"
    async with asyncio.timeout(PATIENCE_S):
        while not ana.withdrawn:
            await asyncio.sleep(0)


async def test_a_client_that_cannot_answer_leaves_the_question_to_the_others(ana: Person, ben: Person) -> None:
    question = Attached(ana, ben).asking()
    await asked(ana, ben)
    assert ana.asked is not None
    assert ben.asked is not None
    ana.asked.set_exception(ConnectionError("gone"))
    ben.asked.set_result(chosen("allow_once"))
    assert (await question).by == "Ben"


async def test_the_answer_of_one_who_may_no_longer_approve_does_not_count(ana: Person) -> None:
    question = Attached(ana).asking()
    await asked(ana)
    ana.may_approve = False
    ana.says("allow_once")
    assert await question == Outcome(False, "nobody")


async def test_what_needs_four_eyes_is_not_asked_of_the_asker(ana: Person, ben: Person) -> None:
    requests = Attached(ana, ben)
    question = requests.asking("Ana", four_eyes=True)
    await asked(ben)
    assert ana.asked is None
    ben.says("allow_once")
    assert (await question).by == "Ben"
    alone = Attached(ana).asking("Ana", four_eyes=True)
    assert await alone == Outcome(False, "nobody")


async def test_a_client_that_no_token_proves_is_no_second_person(ana: Person, ben: Person) -> None:
    ben.identity = Identity("local", Role.SUPERVISOR)
    alone = Attached(ben).asking("Ana", four_eyes=True)
    assert await alone == Outcome(False, "nobody")
    assert ben.asked is None
    nobody_knows_who = Attached(ana).ask("s1", CALL, "speech", "local", ben.identity)
    assert await nobody_knows_who == Outcome(False, "nobody")
    assert ana.asked is None


async def test_who_becomes_the_asker_while_the_question_is_open_does_not_answer_it(ana: Person, ben: Person) -> None:
    question = Attached(ben).asking("Ana", four_eyes=True)
    await asked(ben)
    ben.identity = proven("Ana")  # the same connection, logged in anew
    ben.says("allow_once")
    assert await question == Outcome(False, "nobody")


async def test_a_client_without_a_token_is_not_expected_back_for_somebody_of_its_name(ana: Person) -> None:
    unproven, requests = Person("Ana"), Attached(ana)
    unproven.identity = Identity("Ana", Role.SUPERVISOR)
    requests.attach(unproven)
    requests.detach(ana)
    requests.detach(unproven)
    question = requests.asking("Ben", four_eyes=True)
    await asyncio.sleep(0)
    assert not question.done()
    requests.attach(ana)
    await asked(ana)
    ana.says("allow_once")
    assert (await question).by == "Ana"


async def test_nobody_to_ask_refuses_at_once() -> None:
    assert await Attached().asking() == Outcome(False, "nobody")


async def test_with_somebody_who_may_come_it_waits_and_asks_who_comes(ana: Person) -> None:
    requests = Attached(absent=AbsentApprovers(lambda: [ana]))
    question = requests.asking()
    await asyncio.sleep(0)
    assert not question.done()
    requests.attach(ana)
    await asked(ana)
    ana.says("allow_once")
    assert (await question).by == "Ana"
    assert await requests.asking("Ana", four_eyes=True) == Outcome(False, "nobody")


async def test_no_answer_in_time_refuses(ana: Person) -> None:
    assert await Attached(ana, timeout_s=0.05).asking() == Outcome(False, "timeout")


async def test_when_the_last_one_leaves_and_does_not_come_back_it_is_refused(ana: Person) -> None:
    requests = Attached(ana, absent=AbsentApprovers(grace_s=0.05))
    question = requests.asking()
    await asked(ana)
    requests.detach(ana)
    assert await question == Outcome(False, "nobody")
    assert await requests.asking() == Outcome(False, "nobody")  # nobody is expected any more


async def test_one_whose_answer_did_not_count_keeps_no_question_open(ana: Person, ben: Person) -> None:
    requests = Attached(ana, ben, absent=AbsentApprovers(grace_s=0.05))
    question = requests.asking()
    await asked(ben)
    assert ben.asked is not None
    ben.asked.set_exception(RuntimeError("cannot show it"))
    await asyncio.sleep(0)
    requests.detach(ana)
    assert await question == Outcome(False, "nobody")


async def test_one_whose_answer_did_not_count_speaks_for_nobody_who_is_expected(ana: Person, ben: Person) -> None:
    requests = Attached(ana, ben)
    requests.detach(ana)
    question = requests.asking()
    await asked(ben)
    assert ben.asked is not None
    ben.asked.set_exception(RuntimeError("cannot show it"))
    again = Person("Ana")
    requests.attach(again)
    await asked(again)
    again.says("allow_once")
    assert (await question).by == "Ana"


async def test_one_who_is_expected_is_expected_in_every_session(ana: Person) -> None:
    absent = AbsentApprovers()
    here, there = Attached(ana, absent=absent), Attached(absent=absent)
    here.detach(ana)
    question = there.asking()
    await asyncio.sleep(0)
    assert not question.done()
    there.attach(ana)
    await asked(ana)
    ana.says("allow_once")
    assert (await question).by == "Ana"


async def test_one_who_is_expected_no_longer_is_so_in_no_session(ana: Person) -> None:
    watching = [ana]
    absent = AbsentApprovers(lambda: watching, grace_s=0.05)
    here, there = Attached(ana, absent=absent), Attached(absent=absent)
    question = there.asking()
    await asyncio.sleep(0)
    watching.clear()
    here.detach(ana)
    assert await question == Outcome(False, "nobody")


async def test_one_whose_login_has_ended_is_not_waited_for(ana: Person) -> None:
    requests = Attached(ana)
    question = requests.asking()
    await asked(ana)
    ana.may_approve = False
    requests.detach(ana)
    assert await question == Outcome(False, "nobody")


async def test_the_last_one_who_comes_back_is_asked_again(ana: Person) -> None:
    requests = Attached(ana)
    question = requests.asking()
    await asked(ana)
    requests.detach(ana)
    again = Person("Ana")
    requests.attach(again)
    await asked(again)
    again.says("allow_once")
    assert await question == Outcome(True, "selected", "allow_once", "Ana")


async def test_what_is_asked_while_they_are_away_waits_for_them(ana: Person) -> None:
    requests = Attached(ana)
    requests.detach(ana)
    question = requests.asking()
    again = Person("Ana")
    await asyncio.sleep(0)
    requests.attach(again)
    await asked(again)
    again.says("reject_once")
    assert (await question).by == "Ana"


async def test_a_connection_that_breaks_is_somebody_who_may_come_back(ana: Person) -> None:
    requests = Attached(ana)
    question = requests.asking()
    await asked(ana)
    assert ana.asked is not None
    ana.asked.set_exception(ConnectionError("gone"))
    await asyncio.sleep(0)
    requests.detach(ana)
    again = Person("Ana")
    requests.attach(again)
    await asked(again)
    again.says("allow_once")
    assert (await question).allowed


async def test_whoever_asked_is_not_waited_for_where_somebody_else_has_to_agree(ana: Person) -> None:
    requests = Attached(ana)
    requests.detach(ana)
    assert await requests.asking("Ana", four_eyes=True) == Outcome(False, "nobody")


async def test_one_who_opens_the_session_again_is_asked_again_and_refuses_nothing_by_that(ana: Person) -> None:
    requests = Attached(ana)
    question = requests.asking()
    await asked(ana)
    requests.detach(ana, reattaching=True)
    async with asyncio.timeout(PATIENCE_S):
        while not ana.withdrawn:
            await asyncio.sleep(0)
    ana.asked = None
    requests.attach(ana)
    await asked(ana)
    ana.says("allow_once")
    assert (await question).allowed


async def test_one_who_comes_later_gets_the_pending_question(ana: Person, ben: Person) -> None:
    requests = Attached(ana)
    question = requests.asking()
    await asked(ana)
    requests.attach(ben)
    await asked(ben)
    ben.says("allow_once")
    assert (await question).by == "Ben"


@pytest.mark.parametrize("option", ["allow_always", "reject_always"])
async def test_what_needs_four_eyes_has_no_always(ana: Person, option: str) -> None:
    question = Attached(ana).asking("Ben", four_eyes=True)
    await asked(ana)
    assert ana.asked is not None
    assert ana.offered == ["allow_once", "reject_once"]
    ana.asked.set_result(chosen(option))
    assert await question == Outcome(False, "nobody")
