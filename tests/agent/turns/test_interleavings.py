"""Generated interleavings of people who come, go, ask, cancel, decide and take over, and of `kill -9`.

There are 15, the same in every run; in a deep run there are 100, which are different each time. `interleaving.py` says
what happens in one and what has to be true of it. ROBOT_ACP_TEST_SEED=<number> repeats a run whose number was printed.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import seed as seeded
from hypothesis.stateful import run_state_machine_as_test

from tests.agent.crowd import Site
from tests.agent.turns.interleaving import STEPS, Interleaving
from tests.deep import DEEP, seed

pytestmark = pytest.mark.processes

EXAMPLES = 100 if DEEP else 15
AT_LEAST_IN_A_HUNDRED = {
    "load": 80,
    "resume": 30,
    "leave": 80,
    "prompt": 150,
    "compete": 15,
    "session/cancel": 10,
    "$/cancel_request": 2,
    "decide": 8,
    "take_over": 5,
    "stop": 15,
    "nobody is left": 40,
    "left alone": 20,
    "kill": 20,
    "kill in mid-drive": 10,
    "told that a turn was cut short": 10,
    "all was quiet": 80,
    "events checked": 4000,
}
"""How often each of these has to happen in a hundred interleavings: a test that does nothing finds nothing."""


def at_least(what: str) -> int:
    """How often it has to happen in this run. A few interleavings hold less of what is rare than their share."""
    return AT_LEAST_IN_A_HUNDRED[what] if DEEP else AT_LEAST_IN_A_HUNDRED[what] * EXAMPLES // 200


@pytest.fixture
def at_the_site(tmp_path: Path) -> Iterator[tuple[Site, Callable[[Coroutine[Any, Any, Any]], Any]]]:
    with asyncio.Runner() as runner:
        site = Site(tmp_path)
        runner.run(site.__aenter__())
        try:
            yield site, runner.run
        finally:
            runner.run(site.__aexit__())


def test_interleavings(at_the_site: tuple[Site, Callable[[Coroutine[Any, Any, Any]], Any]]) -> None:
    site, run = at_the_site

    @seeded(seed(1))
    def interleaving() -> Interleaving:
        return Interleaving(site, run)

    options = settings(
        max_examples=EXAMPLES,
        stateful_step_count=STEPS,
        deadline=None,
        database=None,
        phases=[Phase.generate],  # a shorter sequence would be another race
        suppress_health_check=list(HealthCheck),
    )
    try:
        run_state_machine_as_test(interleaving, settings=options)
    except Exception:
        if site.failure:
            raise site.failure from None
        raise
    # Each of the six decisions is so rare that one of them may be missing by chance.
    site.done["decide"] = sum(often for what, often in site.done.items() if what.startswith("decide: "))
    rare = {what: site.done[what] for what in AT_LEAST_IN_A_HUNDRED if site.done[what] < at_least(what)}
    assert not rare, f"hardly happened: {rare}; all that was done: {dict(site.done)}"
    assert site.examples >= EXAMPLES  # hypothesis counts only those that used up none of its limits
