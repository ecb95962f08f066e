"""Prompts to one session that come while a turn runs: they wait, one after another, for whoever asked."""

from __future__ import annotations

import pytest

from backend.agent.sessions.session import MAX_WAITING
from backend.chat.link import RefusedError
from tests.agent.conftest import Opener
from tests.processes import Robot, eventually


async def test_two_prompts_to_one_session_run_one_after_the_other(robot: Robot, connect: Opener) -> None:
    ana, ben = await connect(), await connect()
    session = await ana.new()
    await ben.load(session)
    async with robot.watched() as watched:
        first = ana.later(ana.prompt("say one"))
        await eventually(lambda: ben.of("user_message_chunk"), "the first turn")
        second = ben.later(ben.prompt("say two"))
        assert (await first, await second) == ("end_turn", "end_turn")
        assert watched.spoken == ["One.", "Two."]
    late = await connect()
    await late.load(session)
    metas = [update.get("_meta") or {} for update in late.updates]
    turns = [meta["robot-acp/turn"] for meta in metas if "robot-acp/turn" in meta]
    assert [turn["state"] for turn in turns] == ["running", "ended", "running", "ended"]
    one, also_one, two, also_two = [turn["id"] for turn in turns]
    assert one == also_one != two == also_two


async def test_a_cancel_ends_the_turn_and_those_that_wait_for_it(robot: Robot, connect: Opener) -> None:
    ana, ben = await connect(answer=None), await connect(answer=None)
    session = await ana.new()
    await ben.load(session)
    async with robot.watched() as watched:
        first = ana.later(ana.prompt("say one"))
        await eventually(lambda: ben.questions, "the question of the first turn")
        second = ben.later(ben.prompt("say two"))
        # Answered in the order of the wire: the prompt is with the session once this has come back.
        await ben.link.request("session/list", {})
        await ana.cancel()
        assert (await first, await second) == ("cancelled", "cancelled")
        assert watched.spoken == []
    assert len(ben.questions) == 1


async def test_only_so_many_prompts_may_wait(connect: Opener) -> None:
    client = await connect(answer=None)
    await client.new()
    first = client.later(client.prompt("say one"))
    await eventually(lambda: client.questions, "the question of the first turn")
    waiting = [client.later(client.prompt("say two")) for _ in range(MAX_WAITING)]
    await client.link.request("session/list", {})  # once this has come back, they are with the session
    with pytest.raises(RefusedError, match=f"{MAX_WAITING} prompts wait in this session"):
        await client.prompt("say three")
    await client.cancel()
    assert {await turn for turn in (first, *waiting)} == {"cancelled"}
    assert await client.prompt("where are you?") == "end_turn"
