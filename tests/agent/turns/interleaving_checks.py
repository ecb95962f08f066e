"""What has to be true after each step of an interleaving, and at its end.

After every step, for every connection: the events that it was shown are the log, without a gap, a duplicate or a change
of order; the turn that has the lease runs; the robot moves only for a turn that runs. At the end every prompt and every
question has been answered, and the next prompt gets the robot at once.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Coroutine
from typing import Any

from hypothesis.stateful import RuleBasedStateMachine

from backend.chat.link import LinkError
from backend.identity import Role
from tests.agent.crowd import SOON_S, Asked, Log, Person, Seat, Site, at_rest, soon
from tests.processes import Client, eventually

LEFT_ALONE = "Nobody who may operate me is connected any more"

ANA, BEN, AMY, VIC, VERA = "Ana", "Ben", "Amy", "Vic", "Vera"
ROLES = {ANA: Role.SUPERVISOR, BEN: Role.OPERATOR, AMY: Role.OPERATOR, VIC: Role.VIEWER, VERA: Role.VISITOR}
BENS, VERAS = 0, 1


class Checked(RuleBasedStateMachine):
    """The state of an interleaving, and the checks on it."""

    def __init__(self, site: Site, run: Callable[[Coroutine[Any, Any, Any]], Any]) -> None:
        super().__init__()
        self.site = site
        self.run = run
        self.people = {name: Person(name, role) for name, role in ROLES.items()}
        self.logs: dict[str, Log] = {}
        self.ids: list[str] = []
        self.asked: list[Asked] = []
        self.steps = 0
        self.death = 0
        """The step after which the agent is killed; most agents live longer than their interleaving."""
        self.prompts = 0
        self.still_since: int | None = None
        """Index of the robot's state since which nothing has been under way, and nothing that was asked for waits."""
        self.attended_since: float | None = None
        self.attended: list[tuple[float, float]] = []
        """When somebody who may operate the robot was attached, without a break: Unix seconds."""
        self.story: list[str] = []
        self.sound = False
        """Whether the step before went through."""

    # What has to be true

    async def _check(self) -> None:
        self._check_nobody_was_cut_off()
        await self._check_events()
        self._check_answers()
        self._check_attendance()
        await soon(self._somebody_answers_for_it, "a turn to answer for the lease and the motion")
        if await self._quiet():
            await eventually(lambda: not self.site.moving, "the robot at rest with nothing under way", SOON_S)
            self._nothing_has_moved()
            self.still_since = len(self.site.watched.states) - 1
            self.site.done["all was quiet"] += 1

    async def _read_logs(self) -> None:
        for log in self.logs.values():
            await log.catch_up()

    async def _check_events(self) -> None:
        heard = [(view, session, seat.heard(session)) for seat in self._seats for session, view in seat.views.items()]
        await self._read_logs()  # only now: what was shown before has been kept before
        for view, session, events in heard:
            view.follows(self.logs[session], events)

    @property
    def _seats(self) -> list[Seat]:
        """All connections that there have been."""
        return [seat for person in self.people.values() for seat in [*person.past, person.seat] if seat]

    def _check_answers(self) -> None:
        for asked in self.asked:
            if not asked.answer.done():
                continue
            error = asked.answer.exception()
            if error is None:
                assert asked.answer.result() in ("end_turn", "cancelled")
            else:
                assert isinstance(error, LinkError), f"{asked.seat.who.name}: {error!r}"
                assert not asked.seat.alive

    async def _somebody_answers_for_it(self) -> bool:
        holder, moving = self.site.holder, self.site.moving
        await self._read_logs()
        if holder is None:
            return not moving
        return self.logs[holder].under_way is not None

    async def _over(self) -> bool:
        """Whether nothing is under way, and every prompt has been answered whose answer can still come."""
        await self._read_logs()
        return all(a.answer.done() for a in self.asked) and not any(log.under_way for log in self.logs.values())

    async def _quiet(self) -> bool:
        """Whether, besides, no prompt of a connection that was cut can begin yet."""
        return await self._over() and all(self._begun(a) for a in self.asked if a.answer.exception())

    def _begun(self, asked: Asked) -> bool:
        return any(u.get("content") == {"type": "text", "text": asked.text} for u in self.logs[asked.session].updates)

    def _nothing_has_moved(self) -> None:
        if self.still_since is not None:
            states = self.site.watched.states[self.still_since :]
            assert all(at_rest(state) for _, state in states), "the robot moved for nobody"
        self.still_since = None

    # Who is there

    def _there(self, but: Person | None = None) -> int:
        seats = [p.seat for p in self.people.values() if p.operates and p is not but]
        return sum(1 for seat in seats if seat and seat.alive and seat.there)

    def _is_there(self, seat: Seat, session: str) -> None:
        """The agent has said that it knows this connection as attached."""
        if session in seat.attached:
            seat.there = True
        if self.attended_since is None and self._there():
            self.attended_since = time.time()

    def _nobody_is_there(self) -> None:
        if self.attended_since is not None:
            self.attended.append((self.attended_since, time.time()))
            self.attended_since = None

    def _check_nobody_was_cut_off(self) -> None:
        for person in self.people.values():
            assert person.seat is None or person.seat.alive or not person.seat.attached, f"{person.name} was cut off"

    def _check_attendance(self) -> None:
        now = [(self.attended_since, time.time())] if self.attended_since is not None else []
        for log in self.logs.values():
            for earliest, latest in log.said(LEFT_ALONE):
                there = [begin < earliest and latest < end for begin, end in self.attended + now]
                assert not any(there), "a turn was ended as nobody's while somebody was there"

    # The end

    async def _end(self) -> None:
        observer = self.site.observer
        for session in self.ids:
            await observer.link.notify("session/cancel", {"sessionId": session})
        await soon(self._over, "every turn to end and every prompt to be answered")
        for session in self.ids:
            await self._probe(session)
        await self._check()
        for log in self.logs.values():
            assert log.under_way is None
            await log.reread()
            self.site.done["left alone"] += len(log.said(LEFT_ALONE))
        for person in self.people.values():
            if seat := person.seat:
                await self._seat_is_in_order(seat)
        await self._check_events()
        for session, log in self.logs.items():
            await self._replay_is_the_log(session, log)
        assert not self.site.moving
        self.site.done["connections checked"] += len(self._seats)
        self.site.done["events checked"] += sum(len(seat.heard(s)) for seat in self._seats for s in seat.views)

    async def _probe(self, session: str) -> None:
        """Whoever asks next gets the robot at once."""
        await eventually(lambda: self.site.holder is None, "the lease to be free", SOON_S)
        self._nothing_has_moved()
        client = await Client.open(self.site.address)
        await client.load(session)
        before = len(client.updates)
        assert await client.prompt("turn right by 7 degrees") == "end_turn"
        statuses = [u["status"] for u in client.updates[before:] if "status" in u]
        assert statuses == ["pending", "in_progress", "completed"], client.updates[before:]
        await client.close()

    async def _seat_is_in_order(self, seat: Seat) -> None:
        if not seat.alive:
            return
        await eventually(lambda: not seat.open_questions, f"the questions to {seat.who.name} to be withdrawn", SOON_S)
        for session, log in self.logs.items():
            if session in seat.attached:
                view = seat.view(session)
                await eventually(
                    lambda view=view, log=log, session=session: view.complete(log, seat.heard(session)),
                    f"the last event for {seat.who.name}",
                    SOON_S,
                )

    async def _replay_is_the_log(self, session: str, log: Log) -> None:
        reader = await Client.open(self.site.address)
        await reader.load(session)
        assert reader.numbers == list(range(1, len(log.updates) + 1))
        assert reader.updates == log.updates
        await reader.close()
