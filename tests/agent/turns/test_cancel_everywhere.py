"""A cancel reaches a turn at every step that the turn takes, and is never lost on the way.

One turn is run again and again, over a real robot server, and cancelled at its first step, at its second and so on:
while it waits, and in the moment in which what it waited for has come. There is no second cancel that would help.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Coroutine, Generator, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from backend import identity
from backend.agent.control.lease import Lease
from backend.agent.control.policy import Policy
from backend.agent.robot.mcp_client import McpClient
from backend.agent.robot.robot_client import RobotClient
from backend.agent.sessions.history import History
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.session import Session
from backend.agent.sessions.store import SessionRow, Store
from backend.agent.turns import model, providers
from backend.agent.turns.environment import TurnEnvironment
from backend.agent.turns.turn import Turn
from backend.audit import Audit
from backend.identity import Identity, Role
from backend.robot_server import RobotServerClient
from tests.agent.control.test_approvers import Person, chosen
from tests.agent.turns.test_other_models import Provider, call, end, text
from tests.processes import PATIENCE_S, Robot, eventually

ANA = Identity("Ana", Role.SUPERVISOR)


@dataclass
class Stepped:
    """A coroutine that is cancelled at its step number `at`: while it waits, or, `late`, when its wait has ended."""

    work: Coroutine[Any, Any, str]
    at: int
    late: bool
    cancel: Callable[[], None]
    step: int = 0
    cancelled: bool = False

    def __await__(self) -> Generator[Any, Any, str]:
        steps = self.work.__await__()
        waited: BaseException | None = None
        while True:
            try:
                future = steps.throw(waited) if waited else next(steps)
            except StopIteration as end:
                return str(end.value)
            self.step += 1
            if self.step == self.at:
                self.cancelled = True
                if self.late and future is not None:
                    future.add_done_callback(lambda _: self.cancel())
                else:
                    asyncio.get_running_loop().call_soon(self.cancel)
            try:
                yield future
                waited = None
            except BaseException as error:
                waited = error


@dataclass(eq=False)
class SteppedTurn:
    """A turn whose work is cancelled at one of its steps."""

    turn: Turn
    session: Session
    at: int
    late: bool
    stepped: Stepped = field(init=False)

    @property
    def id(self) -> str:
        return self.turn.id

    async def work(self) -> str:
        self.stepped = Stepped(self.turn.work(), self.at, self.late, self.session.cancel)
        return await self.stepped

    async def halt(self, error: BaseException) -> str:
        return await self.turn.halt(error)

    def close(self) -> None:
        self.turn.close()

    def seconds(self) -> dict[str, float]:
        return self.turn.seconds()


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    robot = Robot(tmp_path_factory.mktemp("data"))
    with robot.running("robot", "--time-scale", "20", port=robot.robot_port):
        yield robot


@asynccontextmanager
async def environment_of(robot: Robot, store: Store) -> AsyncIterator[TurnEnvironment]:
    bearer = identity.shared_secret(robot.data, identity.ROBOT_TOKEN)
    url = f"http://127.0.0.1:{robot.robot_port}"
    tools = McpClient(f"{url}/mcp", robot.robot_headers, absent="The robot does not answer.")
    link = RobotClient(RobotServerClient(url, bearer))
    following = asyncio.create_task(link.run())
    await eventually(lambda: link.state, "the telemetry")
    audit = Audit(robot.data, "agent")
    yield TurnEnvironment("Sancho", tools, Policy(), link, store, Lease(), 1.0, 10, 1.0, audit=audit)
    following.cancel()
    await asyncio.gather(following, return_exceptions=True)
    await tools.close()


@asynccontextmanager
async def stored(tmp_path: Path) -> AsyncIterator[tuple[Store, Journal]]:
    store = Store(f"sqlite:///{tmp_path / 'sessions.db'}")
    await store.open()
    journal = Journal(store)
    keeping = asyncio.create_task(journal.run())
    yield store, journal
    await journal.flush()
    keeping.cancel()
    await asyncio.gather(keeping, return_exceptions=True)
    await store.close()


@dataclass(frozen=True)
class Scene:
    """A turn that is run many times: the model, the words of the prompt, who asks in which mode, and who answers."""

    model: str
    words: str
    asker: Identity = ANA
    mode: str = "autonomous"
    answer: str | None = None
    before: Callable[[], None] = lambda: None
    stopped: bool = False
    """Whether the robot's stop is set."""
    connects: bool = False
    """Whether the turn has to connect to the robot."""


async def cancel_at_every_step(robot: Robot, tmp_path: Path, scene: Scene, late: bool) -> int:
    """Run the turn until one ends before it is cancelled, and return the number of its steps."""
    async with stored(tmp_path) as (store, journal), environment_of(robot, store) as environment:
        await environment.tools.tools()
        await providers.ready(scene.model)
        if scene.stopped:
            await environment.link.stop("Sue")
            await eventually(lambda: environment.link.state and environment.link.state.stop, "the stop")
        at = 1
        while True:
            row = SessionRow(f"s{at}", "Ana", None, "/", scene.mode, scene.model, None, 0.0, 0.0, thought=False)
            await store.add_session(row)
            session = Session(row, journal, History(), 0, PATIENCE_S, asyncio.create_task)  # type: ignore[arg-type]
            if scene.answer:
                session.permission_requests.attach(Quick(scene.answer))
            scene.before()
            if scene.connects:
                await environment.tools._drop()
            prompt = [{"type": "text", "text": scene.words}]
            turn = SteppedTurn(Turn(environment, session, scene.asker, prompt, None), session, at, late)
            async with asyncio.timeout(PATIENCE_S):
                reason = await session.run_turn(turn)
            if not turn.stepped.cancelled:
                assert reason == "end_turn"
                await environment.link.release("Sue")
                return at
            assert reason == "cancelled", f"lost at step {at} of {scene.words!r}: {session.history.messages()}"
            assert environment.lease.holder is None
            assert await robot.stands()
            at += 1


class Quick(Person):
    """Somebody who answers every question at once."""

    def __init__(self, option: str) -> None:
        super().__init__("Sue")
        self._option = option

    async def request(self, method: str, params: dict[str, Any]) -> Any:
        await asyncio.sleep(0)
        return chosen(self._option)


VISITOR = Identity("Vera", Role.VISITOR)
OFFLINE = model.OFFLINE_MODEL
SCENES = {
    "a motion and a reading": Scene(OFFLINE, "turn left by 20 degrees, then tell me where you are"),
    "a question and an answer": Scene(OFFLINE, "say hello", mode="supervised", answer="allow_once"),
    "a preview that is taken back": Scene(OFFLINE, "go to (4.2, 3.0)", VISITOR, answer="reject_once"),
    "a motion that the robot refuses": Scene(OFFLINE, "go to (400, 300)"),
    "a question that a stop saves people": Scene(OFFLINE, "say hello", mode="supervised", answer="no", stopped=True),
    "a robot that is connected to": Scene(OFFLINE, "where are you?", connects=True),
}


@pytest.mark.parametrize("late", [False, True], ids=["while it waits", "when it has waited"])
@pytest.mark.parametrize("name", list(SCENES))
async def test_of_the_offline_model(robot: Robot, tmp_path: Path, name: str, late: bool) -> None:
    assert await cancel_at_every_step(robot, tmp_path, SCENES[name], late) > 5


TURNS = [text("I turn. "), call("rotate_in_place", '{"degrees": 20}'), end("tool_calls")]
CALLS_WRONGLY = [call("rotate_in_place", '{"degrees": "a little"}'), end("tool_calls")]
SAYS_SO = [text("Done."), end("stop")]


@pytest.mark.parametrize("late", [False, True], ids=["while it waits", "when it has waited"])
@pytest.mark.parametrize(
    ("name", "answers"),
    [
        ("openai/m", [TURNS, SAYS_SO]),
        ("openai/m", [CALLS_WRONGLY, SAYS_SO]),
        ("openai/m", [400]),
        ("anthropic/claude-sonnet-4-5", [400]),  # here litellm itself reads the error
    ],
)
async def test_of_a_providers_model(
    robot: Robot,
    tmp_path: Path,
    name: str,
    answers: list[list[dict[str, Any]] | int],
    late: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    provider = Provider()

    def before() -> None:
        provider.answers = list(answers)

    async with provider.running():
        for maker in ("OPENAI", "ANTHROPIC"):
            monkeypatch.setenv(f"{maker}_API_KEY", "none")
            monkeypatch.setenv(f"{maker}_API_BASE", f"http://127.0.0.1:{provider.port}/v1")
        assert await cancel_at_every_step(robot, tmp_path, Scene(name, "turn a little", before=before), late) > 2


async def test_a_provider_that_keeps_its_cancel_to_itself_keeps_nobody(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from backend.agent.turns import litellm_models

    asked, swallowed, enough = asyncio.Event(), asyncio.Event(), asyncio.Event()

    async def acompletion(**_: Any) -> None:
        asked.set()
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.Event().wait()
        swallowed.set()
        await enough.wait()

    monkeypatch.setattr(litellm_models.litellm, "acompletion", acompletion)
    async with stored(tmp_path) as (store, journal), environment_of(robot, store) as environment:
        row = SessionRow("s1", "Ana", None, "/", "autonomous", "openai/m", None, 0.0, 0.0, thought=False)
        await store.add_session(row)
        session = Session(row, journal, History(), 0, 1.0, asyncio.create_task)  # type: ignore[arg-type]
        prompt = [{"type": "text", "text": "turn"}]
        turn = asyncio.create_task(session.run_turn(Turn(environment, session, ANA, prompt, None)))
        await eventually(asked.is_set, "the provider to be asked")
        session.cancel()
        async with asyncio.timeout(PATIENCE_S):
            assert await turn == "cancelled"
        await eventually(swallowed.is_set, "the provider's own cancel")
        enough.set()
