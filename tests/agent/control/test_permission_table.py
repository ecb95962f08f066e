"""Mode × tool × role, through the agent down to the robot: allowed, asks, denied, shown; and every way to say no."""

from __future__ import annotations

import contextlib
import json
import math
import re
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from dataclasses import dataclass

import pytest

from backend.agent.control.policy import MODE_IDS, MODES_IN_ORDER
from backend.identity import Role
from backend.telemetry import Pose
from tests.agent.conftest import TIME_SCALE, Opener
from tests.processes import Client, Robot, Watched, eventually

pytestmark = pytest.mark.processes

WORDS = {
    "get_topological_map": "which places are there?",
    "get_current_pose": "where are you?",
    "get_robot_status": "how is the battery?",
    "take_photo": "take a photo",
    "rotate_in_place": "turn left by 15 degrees",
    "navigate_to_place": "go to the reception",
    "navigate_to_pose": "go to (4.2, 3.0)",
    "speak": "say hello",
}
"""What to say so that the offline model uses a tool."""
LOOKING = ("get_topological_map", "get_current_pose", "get_robot_status", "take_photo")
MOTION = ("rotate_in_place", "navigate_to_place", "navigate_to_pose")

STAFF = {
    #              turn      to a place  to a point  speech
    "observe": ("denied", "denied", "denied", "denied"),
    "plan": ("denied", "shown", "shown", "denied"),
    "movement": ("allowed", "allowed", "allowed", "denied"),
    "supervised": ("allowed", "allowed", "allowed", "asks"),
    "autonomous": ("allowed", "allowed", "allowed", "allowed"),
}
VISITOR = STAFF | {
    "movement": ("allowed", "allowed", "asks", "denied"),
    "supervised": ("allowed", "allowed", "asks", "asks"),
    "autonomous": ("allowed", "allowed", "asks", "asks"),
}
TABLE = [
    (role, mode, tool, answer)
    for role, by_mode in ((Role.VISITOR, VISITOR), (Role.OPERATOR, STAFF), (Role.SUPERVISOR, STAFF))
    for mode in MODES_IN_ORDER
    for tool, answer in [
        *((tool, "allowed") for tool in LOOKING),
        *zip((*MOTION, "speak"), by_mode[mode], strict=True),
    ]
]


@dataclass
class Staged:
    """Somebody who asks in a session of their own, and Sue, a supervisor, who watches it and is asked."""

    asker: Client
    sue: Client
    robot: Robot
    watched: Watched
    moved: bool = False
    """Whether the robot moved for what was said last."""

    async def says(self, tool: str, answer: str | None) -> None:
        """Let the asker use a tool, with Sue's answer should she be asked."""
        self.sue.answer = answer
        for client in (self.asker, self.sue):
            client.heard.clear()
            client.questions.clear()
        self.watched.states.clear()
        self.watched.spoken.clear()
        self.watched.previews = 0
        before = await self.robot.state()
        words = WORDS[tool]
        if tool == "navigate_to_place" and is_near(before.pose, 3.2, 3.0):
            words = "go to the dock"  # somewhere else than here
        if tool == "navigate_to_pose" and is_near(before.pose, 4.2, 3.0):
            words = "go to (2.2, 3.0)"
        assert await self.asker.prompt(words) == "end_turn"
        after = await self.robot.state()  # of a short motion no state may have told
        seen = any(state.twist.linear or state.twist.angular or state.motion for _, state in self.watched.states)
        self.moved = seen or after.pose != before.pose

    def end_of(self, tool: str) -> str:
        """How the last call of a tool ended."""
        calls = [c for c in self.asker.of("tool_call") if c["_meta"]["robot-acp/tool"] == tool]
        ends = [u for u in self.asker.of("tool_call_update") if u["toolCallId"] == calls[-1]["toolCallId"]]
        return str(ends[-1]["status"])

    def done(self, tool: str) -> bool:
        """Whether the robot itself did what the tool does."""
        if tool in MOTION:
            return self.moved
        return self.watched.spoken == ["Hello."] if tool == "speak" else self.end_of(tool) == "completed"


def is_near(pose: Pose, x: float, y: float) -> bool:
    return math.dist((pose.x, pose.y), (x, y)) < 0.5


Stage = Callable[[Role, str], Awaitable[Staged]]
Way = Callable[[Staged, str, Robot, Opener], Awaitable[None]]


async def staged(robot: Robot, connect: Opener, watched: Watched, role: Role, mode: str) -> Staged:
    asker = await connect(robot.token("Ann", role), answer=None)
    sue = await connect(robot.token("Sue", Role.SUPERVISOR))
    session = await asker.new()
    await sue.load(session)
    await sue.link.request("session/set_mode", {"sessionId": session, "modeId": mode})
    return Staged(asker, sue, robot, watched)


@pytest.fixture
async def stage(robot: Robot, connect: Opener) -> AsyncIterator[Stage]:
    async with robot.watched() as watched:
        yield lambda role, mode: staged(robot, connect, watched, role, mode)


@pytest.mark.parametrize(("role", "mode", "tool", "answer"), TABLE, ids=lambda value: str(value))
async def test_table(stage: Stage, role: Role, mode: str, tool: str, answer: str) -> None:
    scene = await stage(role, mode)
    await scene.says(tool, "reject_once")
    assert len(scene.sue.questions) == (answer == "asks")
    assert scene.done(tool) == (answer == "allowed")
    assert scene.moved == (answer == "allowed" and tool in MOTION)
    assert scene.end_of(tool) == ("completed" if answer in ("allowed", "shown") else "failed")
    if answer != "asks":  # people who are asked to let it drive are shown the way, too
        assert (scene.watched.previews > 0) == (answer == "shown")
    if answer == "denied":
        assert f"not allowed in the mode {mode.capitalize()}" in json.dumps(scene.asker.updates)
    if answer == "asks":
        await scene.says(tool, "allow_once")
        assert scene.done(tool)
        assert scene.end_of(tool) == "completed"
    # Only those who may approve are asked.
    assert bool(scene.asker.questions) == (answer == "asks" and role is not Role.VISITOR)


def test_the_table_is_complete() -> None:
    assert set(STAFF) == MODE_IDS
    assert len(TABLE) == 3 * len(MODE_IDS) * len(WORDS)


ASKING = {"map": ["get_topological_map"], "rest": [tool for tool in WORDS if tool != "get_topological_map"]}
"""Tools that ask in every mode, whatever the built-in table says. The map has an agent of its own: the way to a place
begins with it."""


@dataclass
class Strict:
    """A robot whose tools ask in every mode: an agent that waits for an answer, and one that hardly does."""

    which: str
    patient: Robot
    hasty: Robot


@pytest.fixture(scope="module", params=list(ASKING))
def strict(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Strict]:
    table = {mode: dict.fromkeys(ASKING[request.param], "ask") for mode in MODES_IN_ORDER}
    patient = Robot(tmp_path_factory.mktemp("data"), {"ROBOT_ACP_AGENT__POLICY": json.dumps(table)})
    hasty = patient.with_another_agent({"ROBOT_ACP_AGENT__PERMISSION_TIMEOUT": "0.4"})
    with (
        patient.running("robot", "--time-scale", TIME_SCALE, port=patient.robot_port),
        patient.running("agent", port=patient.agent_port),
        hasty.running("agent", port=hasty.agent_port),
    ):
        yield Strict(request.param, patient, hasty)


@contextlib.asynccontextmanager
async def clients_of(robot: Robot) -> AsyncIterator[Opener]:
    """Opens clients of one of the agents."""
    clients: list[Client] = []

    async def opened(token: str, **options: object) -> Client:
        client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}", **options)
        await client.link.request("authenticate", {"methodId": "token", "_meta": {"robot-acp/token": token}})
        clients.append(client)
        return client

    yield opened
    for client in clients:
        await client.close()


@pytest.mark.parametrize("mode", MODES_IN_ORDER)
async def test_every_way_to_say_no_refuses_every_tool(strict: Strict, mode: str) -> None:
    await refuse_all(strict.which, strict.patient, mode, WAYS_TO_SAY_NO)


@pytest.mark.parametrize("mode", MODES_IN_ORDER)
async def test_no_answer_refuses_every_tool(strict: Strict, mode: str) -> None:
    await refuse_all(strict.which, strict.hasty, mode, WAYS_TO_SAY_NOTHING)


async def refuse_all(which: str, robot: Robot, mode: str, ways: dict[Way, str]) -> None:
    """Ask for each tool, and refuse it in each of the ways."""
    async with robot.watched() as watched:
        for tool in ASKING[which]:
            if mode == "plan" and tool in ("navigate_to_place", "navigate_to_pose"):
                continue  # shows its path without asking: `test_table`
            async with clients_of(robot) as connect:  # nobody is left who might come from another session
                scene = await staged(robot, connect, watched, Role.VISITOR, mode)
                for way, reason in ways.items():
                    await way(scene, tool, robot, connect)
                    assert scene.end_of(tool) == "failed", way.__name__
                    assert re.search(reason, scene.asker.said), way.__name__
                    assert not scene.moved, way.__name__
                    assert watched.spoken == [], way.__name__


async def rejecting(scene: Staged, tool: str, *_: object) -> None:
    await scene.says(tool, "reject_once")


async def choosing_what_was_never_offered(scene: Staged, tool: str, *_: object) -> None:
    await scene.says(tool, "allow_everything")


async def answering_with_no_outcome(scene: Staged, tool: str, *_: object) -> None:
    await beside(scene, tool, lambda question: scene.sue.link.respond(question, {"outcome": {"outcome": "allow_once"}}))


async def answering_with_an_error(scene: Staged, tool: str, *_: object) -> None:
    await beside(scene, tool, lambda question: scene.sue.link.refuse(question))


async def leaving(scene: Staged, tool: str, robot: Robot, connect: Opener) -> None:
    await beside(scene, tool, lambda _: scene.sue.close())
    scene.sue = await connect(robot.token("Sue", Role.SUPERVISOR))
    await scene.sue.load(scene.asker.session)


async def not_answering_while_those_do_who_may_not(scene: Staged, tool: str, robot: Robot, connect: Opener) -> None:
    viewer = await connect(robot.token("Vic", Role.VIEWER))
    await viewer.load(scene.asker.session)

    async def forge(question: str) -> None:
        for client in (viewer, scene.asker):
            for guess in (question, "p1", "p2", 1):
                await client.link.respond(guess, {"outcome": {"outcome": "selected", "optionId": "allow_once"}})

    await beside(scene, tool, forge)
    assert viewer.questions == []
    await viewer.close()


async def changing_ones_mind(scene: Staged, tool: str, *_: object) -> None:
    async def both(question: str) -> None:
        for option in ("reject_once", "allow_once"):
            await scene.sue.link.respond(question, {"outcome": {"outcome": "selected", "optionId": option}})

    await beside(scene, tool, both)


async def being_second(scene: Staged, tool: str, robot: Robot, connect: Opener) -> None:
    ben = await connect(robot.token("Ben", Role.OPERATOR), answer=None)
    await ben.load(scene.asker.session)

    async def after_sue(question: str) -> None:
        await eventually(lambda: ben.questions, "the same question to Ben")
        await scene.sue.link.respond(question, {"outcome": {"outcome": "selected", "optionId": "reject_once"}})
        await eventually(lambda: any(m["method"] == "$/cancel_request" for m in ben.heard), "its end at Ben's")
        await ben.decide("allow_once")

    await beside(scene, tool, after_sue)
    await ben.link.request("logout", {})  # or the next question would wait for Ben to come back
    await ben.close()


async def rejecting_for_good(scene: Staged, tool: str, *_: object) -> None:
    await scene.says(tool, "reject_always")
    await scene.says(tool, "allow_once")
    assert scene.sue.questions == []


async def beside(scene: Staged, tool: str, act: Callable[[str], Awaitable[None]]) -> None:
    """Use a tool, and do something with the id of Sue's question once she has it."""
    scene.sue.questions.clear()  # now, not when the task below begins
    asking = scene.asker.later(scene.says(tool, None))
    await eventually(lambda: scene.sue.questions, f"the question whether to {tool}")
    await act(scene.sue.questions[0]["id"])
    await asking


NOBODY = "nobody is there who may allow it"
WAYS_TO_SAY_NO: dict[Way, str] = {
    rejecting: "refused by Sue",
    choosing_what_was_never_offered: NOBODY,
    answering_with_no_outcome: NOBODY,
    answering_with_an_error: NOBODY,
    changing_ones_mind: "refused by Sue",
    being_second: "refused by Sue",
    rejecting_for_good: "somebody chose to refuse this for the whole session",
}
"""What people do, and the reason that the robot gives; the last one counts for the rest of the session."""
WAYS_TO_SAY_NOTHING: dict[Way, str] = {
    leaving: "nobody answered in time",  # that time is shorter than they are waited for
    not_answering_while_those_do_who_may_not: "nobody answered in time",
}
