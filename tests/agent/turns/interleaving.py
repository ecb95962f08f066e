"""One generated interleaving of people who come, go, ask, cancel, decide and take over, and of `kill -9`.

The state machine of `test_interleavings.py`: its steps, and what people do in them. The processes are real. What has
to be true after each step and at the end: `interleaving_checks.py`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import initialize, invariant, rule

from backend.chat.link import LinkError, RefusedError
from tests.agent.crowd import SOON_S, Asked, Log, Person, Seat, at_rest, soon
from tests.agent.turns.interleaving_checks import ANA, BEN, BENS, ROLES, VERA, VERAS, Checked
from tests.processes import Client, eventually

STEPS = 6
"""Steps of one interleaving."""
FAR = "turn left by {n} degrees, go to lab 2.3.9 and then come back"
everybody = st.sampled_from(list(ROLES))
sessions = st.sampled_from([BENS, VERAS])
# Each text is sent once, so that an event tells whose prompt it is.
who_may_prompt = st.sampled_from([(BEN, BENS), (ANA, BENS), (VERA, VERAS), (ANA, VERAS)])
wishes = st.sampled_from(
    [
        FAR,
        "turn right by {n} degrees and go to the kitchen",
        "turn left by {n} degrees",
        "say number {n}",
        "go to the kitchen and say number {n}",
        "say number {n} and then turn right by {n} degrees",
        "where are you? ({n})",
    ]
)
Beginning = tuple[str, int, str]
"""Who wants something in which session, and how far it has come when the next thing happens: `motion`, `question`."""
under_way = st.builds(lambda one, upto: (*one, upto), who_may_prompt, st.sampled_from(["motion", "question"]))
drive = st.builds(lambda one: (*one, "motion"), who_may_prompt)
perhaps = st.none() | under_way
decisions = st.sampled_from(["allow_once", "allow_always", "reject_once", "never_offered", "cancelled", "twice"])


class Interleaving(Checked):
    """Two sessions, five people, one robot."""

    # Steps

    @initialize(audience=st.sets(everybody), death=st.integers(1, 6 * STEPS))
    def begin(self, audience: set[str], death: int) -> None:
        if self.site.failure:
            raise self.site.failure  # hypothesis would try it again, which is another race
        self.death = death
        self.step(self._begin(audience), f"begin with {sorted(audience)}")

    @rule(name=everybody, where=sessions, load=st.booleans(), patient=st.booleans(), first=perhaps)
    def attach(self, name: str, where: int, load: bool, patient: bool, first: Beginning | None) -> None:
        how = "load" if load else "resume"
        work = self._attach(self.people[name], where, load=load, patient=patient)
        self.step(work, f"{name} attaches to {where}: {how}, patient: {patient}", first)

    @rule(name=everybody, abruptly=st.booleans(), first=perhaps)
    def leave(self, name: str, abruptly: bool, first: Beginning | None) -> None:
        self.step(self._leave(self.people[name], abruptly=abruptly), f"{name} leaves, abruptly: {abruptly}", first)

    @rule(first=drive)
    def nobody_is_left(self, first: Beginning | None) -> None:
        self.step(self._nobody_is_left(), "all who may operate leave", first)

    @rule(one=who_may_prompt, text=wishes, number=st.integers(1, 2), patience=st.integers(1, 4))
    def prompt(self, one: tuple[str, int], text: str, number: int, patience: int) -> None:
        patient = patience == 4
        work = self._prompts([(*one, text)] * number, patient=patient)
        self.step(work, f"{one[0]} prompts {one[1]}, {number} times, patient: {patient}: {text}")

    @rule(first=wishes, second=wishes)
    def compete(self, first: str, second: str) -> None:
        both = [(BEN, BENS, first), (VERA, VERAS, second)]
        self.step(self._prompts(both, counted="compete"), f"both: {first} / {second}")

    @rule(one=who_may_prompt, by_request=st.booleans(), first=under_way)
    def cancel(self, one: tuple[str, int], by_request: bool, first: Beginning | None) -> None:
        name, where = one
        work = self._cancel(self.people[name], where, by_request)
        self.step(work, f"{name} cancels {where}, by request: {by_request}", first)

    @rule(decision=decisions, one=who_may_prompt)
    def decide(self, decision: str, one: tuple[str, int]) -> None:
        self.step(self._decide(decision), f"somebody decides: {decision}", (*one, "question"))

    @rule(where=sessions, first=drive)
    def take_over(self, where: int, first: Beginning | None) -> None:
        self.step(self._take_over(where), f"Ana takes over for {where}", first)

    @rule(name=everybody, first=perhaps)
    def stop(self, name: str, first: Beginning | None) -> None:
        self.step(self._stop(self.people[name]), f"{name} stops the robot, and it is released", first)

    @invariant()
    def nothing_is_wrong(self) -> None:
        if not self.ids:
            return
        self.steps += 1
        if self.steps == self.death:
            first = (BEN, BENS, "motion") if self.steps % 2 else None
            self.step(self._kill(), "kill the agent", first)
        self.step(self._check(), "check")

    def teardown(self) -> None:
        if not self.ids:
            return  # hypothesis gave it up
        self.site.examples += 1
        if self.sound:
            self.step(self._end(), "end")
        for person in self.people.values():
            if person.seat:
                self.run(person.seat.leave(abruptly=False))

    def step(self, work: Coroutine[Any, Any, Any], what: str, first: Beginning | None = None) -> None:
        """Do it, and tell the whole story when it goes wrong."""
        self.sound = False

        async def in_order() -> None:
            if first is not None:
                self.story.append(f"{first[0]} wants something of {first[1]}, up to the {first[2]}")
                await self._have_begun(*first)
            self.story.append(what)
            await work

        try:
            self.run(in_order())
        except BaseException as error:
            error.add_note("\n".join([f"Interleaving {self.site.examples}, in this order:", *self.story]))
            self.site.failure = self.site.failure or error
            raise
        self.sound = True

    # What people do

    async def _begin(self, audience: set[str]) -> None:
        for name in (BEN, VERA):
            seat = await self._sit(self.people[name])
            session = await seat.client.new()
            self.ids.append(session)
            self.logs[session] = Log(self.site.store, session)
            seat.view(session).begin(None)
            seat.attached.add(session)
            self._is_there(seat, session)
        for name in sorted(audience):
            await self._attach(self.people[name], BENS if name != VERA else VERAS, load=True, patient=True)

    async def _sit(self, person: Person) -> Seat:
        if person.seat is None or not person.seat.alive:
            client = await Client.open(self.site.address, answer=None)
            login = {"methodId": "token", "_meta": {"robot-acp/token": self.site.token(person)}}
            await client.link.request("authenticate", login)
            if person.seat is not None:
                person.past.append(person.seat)
            person.seat = Seat(person, client)
        return person.seat

    async def _attach(self, person: Person, where: int, *, load: bool, patient: bool) -> None:
        seat = await self._sit(person)
        if person.name == VERA and where != VERAS:
            with pytest.raises(RefusedError, match="There is no session"):
                await seat.client.load(self.ids[where])
            return
        person.remember()
        work = self._attached(seat, self.ids[where], 0 if load else person.known.get(self.ids[where], 0), load)
        self.site.done["load" if load else "resume"] += 1
        attaching = seat.client.later(work)
        if patient:
            await attaching
        else:
            await asyncio.sleep(0)  # the request is on its way

    async def _attached(self, seat: Seat, session: str, after: int, load: bool) -> None:
        view = seat.view(session)
        view.begin(after + 1)
        seat.attached.add(session)
        params: dict[str, Any] = {"sessionId": session, "cwd": "/", "mcpServers": []}
        if not load:
            params["_meta"] = {"robot-acp/after": after}
        try:
            await seat.client.link.request("session/load" if load else "session/resume", params)
        except LinkError:
            return  # cut off meanwhile
        view.replaying -= 1
        self._is_there(seat, session)

    async def _leave(self, person: Person, *, abruptly: bool) -> None:
        if person.seat is None or not person.seat.alive:
            return
        self.site.done["leave"] += 1
        if person.operates and self._there(but=person) == 0:
            self._nobody_is_there()
        await person.seat.leave(abruptly=abruptly)

    async def _prompts(
        self, wanted: list[tuple[str, int, str]], counted: str = "prompt", *, patient: bool = False
    ) -> None:
        seats = [await self._sit(self.people[name]) for name, _, _ in wanted]
        self._nothing_has_moved()
        for seat, (_, where, text) in zip(seats, wanted, strict=True):
            self.prompts += 1
            await self._send_prompt(seat, self.ids[where], text.format(n=10 + self.prompts))
        self.site.done[counted] += 1
        if patient:
            await self._until_or_over(lambda: False)

    async def _send_prompt(self, seat: Seat, session: str, text: str) -> None:
        view = seat.view(session)
        if not view.starts:
            view.begin(None)
        seat.attached.add(session)
        view.prompted[text] = view.replaying > 0
        blocks = [{"type": "text", "text": text}]
        request = seat.client.link.request("session/prompt", {"sessionId": session, "prompt": blocks})

        async def answered() -> str:
            reason = str((await request)["stopReason"])
            self._is_there(seat, session)
            return reason

        answer = seat.client.later(answered())
        await asyncio.sleep(0)  # it is on its way
        self.asked.append(Asked(seat, session, text, seat.client.link._asked, answer))

    async def _cancel(self, person: Person, where: int, by_request: bool) -> None:
        seat = await self._sit(person)
        own = [a for a in self.asked if a.seat is seat and a.session == self.ids[where] and not a.answer.done()]
        if by_request and own:
            self.site.done["$/cancel_request"] += 1
            await seat.client.link.notify("$/cancel_request", {"requestId": own[-1].request_id})
        else:
            self.site.done["session/cancel"] += 1
            await seat.client.link.notify("session/cancel", {"sessionId": self.ids[where]})
        # What was asked over this connection before is over now, the robot at rest.
        await eventually(lambda: all(a.answer.done() for a in own), "what was cancelled to end", SOON_S)

    async def _decide(self, decision: str) -> None:
        for person in self.people.values():
            seat = person.seat
            if seat is None or not seat.alive or not seat.open_questions:
                continue
            question = seat.open_questions[0]
            options = {"twice": ["reject_once", "allow_once"]}.get(decision, [decision])
            seat.answered.add(question["id"])
            self.site.done[f"decide: {decision}"] += 1
            for option in options:
                chosen = {"outcome": "selected", "optionId": option}
                outcome = {"outcome": "cancelled"} if option == "cancelled" else chosen
                await seat.client.link.respond(question["id"], {"outcome": outcome})
            return

    async def _take_over(self, where: int) -> None:
        seat = await self._sit(self.people[ANA])
        answer = await seat.client.link.request("_robot/take_over", {"sessionId": self.ids[where]})
        self.site.done["take_over" if answer["from"] else "take_over of a free robot"] += 1

    async def _stop(self, person: Person) -> None:
        seat = await self._sit(person)
        assert (await seat.client.link.request("_robot/stop", {}))["stopped"] is not None
        await eventually(lambda: not self.site.moving, "the robot at rest after a stop", SOON_S)
        await self.site.observer.link.request("_robot/release", {})
        self.site.done["stop"] += 1

    async def _nobody_is_left(self) -> None:
        for person in self.people.values():
            if person.operates:
                await self._leave(person, abruptly=True)
        assert self._there() == 0
        self._nobody_is_there()
        gone = len(self.site.watched.states)
        await eventually(
            lambda: self.site.stands(gone) and self.site.holder is None, "the robot at rest and free", SOON_S
        )
        self.site.done["nobody is left"] += 1

    async def _have_begun(self, name: str, where: int, upto: str) -> None:
        """Let somebody ask for a drive, or for speech, and wait until the robot drives, or people are asked."""
        if upto == "motion":
            await self._prompts([(name, where, FAR)])
            await self._until_or_over(lambda: self.site.moving)
            self.site.done["motion was seen"] += self.site.moving
        else:
            await self._prompts([(name, where, "say number {n}")])
            await self._until_asked_or_over()

    async def _until_asked_or_over(self) -> None:
        await self._until_or_over(
            lambda: any(p.seat and p.seat.alive and p.seat.open_questions for p in self.people.values())
        )

    async def _until_or_over(self, condition: Callable[[], bool]) -> None:
        async def reached() -> bool:
            return condition() or await self._over()

        await soon(reached, "what the people wait for", 30)

    async def _kill(self) -> None:
        self.site.done["kill"] += 1
        self.site.done["kill in mid-drive"] += self.site.moving
        self._nobody_is_there()
        await self.site.kill_agent()
        death = len(self.site.watched.states)
        await eventually(lambda: self.site.stands(death), "the robot at rest after the death of the agent", SOON_S)
        still = len(self.site.watched.states) - 1
        were_there = []
        for person in self.people.values():
            if person.seat and person.seat.alive:
                await eventually(person.seat.client.link.closed.done, "the connections to end", SOON_S)
            if person.seat and person.seat.attached:
                were_there.append((person, sorted(person.seat.attached)))
                person.seat.attached.clear()
                person.seat.there = False
        await self._check_events()  # all that was seen has been kept, before anybody repairs anything
        cut_short = {session for session, log in self.logs.items() if log.under_way}
        await self.site.start_agent()
        assert all(at_rest(state) for _, state in self.site.watched.states[still:])
        for person, attached in were_there:
            for session in attached:
                await self._attach(person, self.ids.index(session), load=False, patient=False)
        for session, log in self.logs.items():  # whoever opens it is told
            before = len(log.updates)
            reader = await Client.open(self.site.address)
            await reader.load(session)
            if session in cut_short:
                assert "I was restarted in the middle of this" in str(reader.updates[before:])
                self.site.done["told that a turn was cut short"] += 1
            await reader.close()
