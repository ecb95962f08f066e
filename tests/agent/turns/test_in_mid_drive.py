"""What comes while the robot drives: a cancel, a stop, another mode, a session that ends. The drive is a long one."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator

import pytest

from backend.chat.link import RefusedError
from backend.identity import Role
from tests.agent.conftest import Opener, far, far_place
from tests.processes import PATIENCE_S, Client, Robot, Watched


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """A robot that takes its time, so that what comes in mid-drive comes in mid-drive on a slow machine, too."""
    with Robot(tmp_path_factory.mktemp("data")).at_work("--time-scale", "4", bridge=False) as robot:
        yield robot


@pytest.fixture
async def watched(robot: Robot) -> AsyncIterator[Watched]:
    """What the robot tells."""
    async with robot.watched() as watched:
        yield watched


@pytest.fixture
async def client(connect: Opener) -> Client:
    """Somebody with a session."""
    client = await connect()
    await client.new()
    return client


async def driving(client: Client, watched: Watched, text: str | None = None) -> asyncio.Task[str]:
    """A turn that drives for a while."""
    turn: asyncio.Task[str] = client.later(client.prompt(text or far(watched)))
    await watched.until(lambda: watched.speed > 0.3, "the robot to drive")
    return turn


async def test_cancel_halts_the_robot_before_the_prompt_answers(robot: Robot, client: Client, watched: Watched) -> None:
    turn = await driving(client, watched)
    await client.cancel()
    assert await turn == "cancelled"
    assert await robot.stands()
    ends = [u["status"] for u in client.of("tool_call_update") if u.get("status") in ("completed", "failed")]
    assert ends == ["completed", "failed"]  # it had read the map
    assert client.updates[-1]["_meta"]["robot-acp/turn"]["stopReason"] == "cancelled"


async def test_a_prompt_that_is_taken_back_is_cancelled_and_answered(
    robot: Robot, client: Client, watched: Watched
) -> None:
    turn = await driving(client, watched)
    await client.link.notify("$/cancel_request", {"requestId": 3})  # initialize, session/new, session/prompt
    assert await turn == "cancelled"
    assert await robot.stands()


async def test_a_prompt_into_a_session_that_is_being_deleted_does_nothing(
    robot: Robot, client: Client, watched: Watched
) -> None:
    turn = await driving(client, watched)
    deleting = client.later(client.link.request("session/delete", {"sessionId": client.session}))
    late = client.later(client.prompt("go to the kitchen"))
    assert await deleting == {}
    assert await turn == "cancelled"
    (outcome,) = await asyncio.gather(late, return_exceptions=True)
    assert outcome == "cancelled" or isinstance(outcome, RefusedError)
    assert await robot.stands()


@pytest.mark.parametrize("method", ["session/close", "session/delete"])
async def test_closing_and_leaving_at_once_frees_the_robot(
    client: Client, watched: Watched, connect: Opener, method: str
) -> None:
    turn = await driving(client, watched)
    closing = client.later(client.link.request(method, {"sessionId": client.session}))
    await asyncio.sleep(0)  # the request is on the wire
    await client.close()
    await asyncio.gather(turn, closing, return_exceptions=True)
    next_one = await connect()
    await next_one.new()
    async with asyncio.timeout(PATIENCE_S):
        assert await next_one.prompt("turn left by 10 degrees") == "end_turn"


async def test_the_stop_command_waits_for_no_turn_that_runs(client: Client, watched: Watched) -> None:
    turn = await driving(client, watched)
    stop = client.later(client.prompt("/stop"))
    try:
        await watched.until(lambda: watched.speed == 0 and watched.state.stop is not None, "the stop")
        assert await turn == "end_turn"
        assert await stop == "end_turn"
    finally:
        await client.link.request("_robot/release", {})
    assert "Stopped by local" in client.said


async def test_anyone_who_sees_a_session_may_stop_in_it(
    robot: Robot, client: Client, watched: Watched, connect: Opener
) -> None:
    viewer = await connect(robot.token("Vic", Role.VIEWER))
    await viewer.load(client.session)
    turn = await driving(client, watched)
    stop = viewer.later(viewer.prompt("/stop"))
    try:
        await watched.until(lambda: watched.speed == 0 and watched.state.stop is not None, "the stop")
        assert (await turn, await stop) == ("end_turn", "end_turn")
        assert watched.state.stop is not None
        assert watched.state.stop.by == "Vic"
    finally:
        await client.link.request("_robot/release", {})
    assert "I am stopped." in viewer.said
    with pytest.raises(RefusedError, match="may not prompt"):
        await viewer.prompt("go to the kitchen")


@pytest.mark.parametrize(
    ("mode", "status", "spoken"), [("observe", "failed", []), ("autonomous", "completed", ["Hello."])]
)
async def test_a_mode_that_changed_in_mid_drive_counts_from_the_next_tool_call_on(
    client: Client, watched: Watched, mode: str, status: str, spoken: list[str]
) -> None:
    turn = await driving(client, watched, f"go to {far_place(watched)}, then go to the corridor, then say hello")
    await client.link.request("session/set_mode", {"sessionId": client.session, "modeId": mode})
    assert await turn == "end_turn"
    assert watched.spoken == spoken
    assert client.questions == []
    drives = [c for c in client.of("tool_call") if c["title"].startswith("Drive to")]
    ends = [[u for u in client.of("tool_call_update") if u["toolCallId"] == d["toolCallId"]][-1] for d in drives]
    # The drive that was under way ends where it should; the next one is the new mode's.
    assert [end["status"] for end in ends] == ["completed", status]
