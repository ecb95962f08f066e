"""A cancel reaches its turn whatever the turn is waiting for, and a turn that ends leaves a robot at rest."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import anyio
import mcp
import mcp_types as types
import pytest
from mcp.server.lowlevel import Server

from backend.agent.control.lease import Lease
from backend.agent.control.policy import Policy
from backend.agent.robot import mcp_client
from backend.agent.robot.mcp_client import McpClient, ServerUnavailable, Tool, ToolResult
from backend.agent.robot.robot_client import RobotClient
from backend.agent.sessions.history import History
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.session import Session
from backend.agent.sessions.store import SessionRow, Store
from backend.agent.turns import model
from backend.agent.turns.environment import TurnEnvironment
from backend.agent.turns.turn import Turn
from backend.audit import Audit
from backend.identity import Identity, Role
from backend.robot_server import RobotServerClient
from backend.telemetry import Battery, Pose, State, Twist
from tests.processes import PATIENCE_S, eventually

ROW = SessionRow("s1", "Ana", None, "/", "supervised", model.OFFLINE_MODEL, None, 0.0, 0.0, thought=False)
ANA = Identity("Ana", Role.SUPERVISOR)


@pytest.fixture
async def session(tmp_path: Path) -> AsyncIterator[Session]:
    """A session of Ana's."""
    store = Store(f"sqlite:///{tmp_path / 'sessions.db'}")
    await store.open()
    await store.add_session(ROW)
    journal = Journal(store)
    keeping = asyncio.create_task(journal.run())
    yield Session(ROW, journal, History(), 0, 1.0, asyncio.create_task)  # type: ignore[arg-type]
    await journal.flush()
    keeping.cancel()
    await asyncio.gather(keeping, return_exceptions=True)
    await store.close()


async def at_once(_: BaseException) -> str:
    """Halts a turn that moved nothing."""
    return "cancelled"


@dataclass(eq=False)
class Working:
    """A turn that does what a test says."""

    doing: Callable[[], Awaitable[str]]
    halting: Callable[[BaseException], Awaitable[str]] = at_once
    id: str = "t1"

    async def work(self) -> str:
        return await self.doing()

    async def halt(self, error: BaseException) -> str:
        return await self.halting(error)

    def close(self) -> None:
        pass

    def seconds(self) -> dict[str, float]:
        return {}


class _Broken:
    """A client whose connection has gone."""

    async def call_tool(self, *_: Any, **__: Any) -> None:
        raise anyio.ClosedResourceError


class Clinging(McpClient):
    """The connection to a server that broke and does not end, because the server does not take leave."""

    def __init__(self) -> None:
        super().__init__("http://127.0.0.1:1/mcp", absent="The lab does not answer.")
        self.asked_to_go = asyncio.Event()
        self.let_go = asyncio.Event()

    async def _own(self, ready: asyncio.Future[mcp.Client], lost: asyncio.Event) -> None:
        ready.set_result(cast(mcp.Client, _Broken()))
        with contextlib.suppress(asyncio.CancelledError):
            await lost.wait()
        self.asked_to_go.set()
        while not self.let_go.is_set():
            with contextlib.suppress(asyncio.CancelledError):
                await self.let_go.wait()


async def test_a_turn_that_takes_leave_of_a_broken_server_is_cancelled_all_the_same(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcp_client, "PARTING_TIMEOUT_S", 10 * PATIENCE_S)
    server = Clinging()
    went_on = False

    async def work() -> str:
        nonlocal went_on
        with contextlib.suppress(ServerUnavailable):
            await server.call("grow_crystals", {})
        went_on = True
        return "end_turn"

    turn = asyncio.create_task(session.run_turn(Working(work)))
    await eventually(server.asked_to_go.is_set, "the connection to be left")
    session.cancel()
    done, _ = await asyncio.wait([turn], timeout=PATIENCE_S)
    server.let_go.set()
    assert done, "the turn cannot be cancelled"
    assert await turn == "cancelled"
    assert not went_on


async def test_a_server_that_does_not_take_leave_makes_nobody_wait_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcp_client, "PARTING_TIMEOUT_S", 0.05)
    server = Clinging()
    async with asyncio.timeout(PATIENCE_S):
        with pytest.raises(ServerUnavailable):
            await server.call("grow_crystals", {})
    server.let_go.set()


async def test_a_second_cancel_does_not_interrupt_what_the_first_one_ends(session: Session) -> None:
    telling, told = asyncio.Event(), asyncio.Event()

    async def work() -> str:
        try:
            await asyncio.Event().wait()
        finally:  # as a tool call that tells its server of the cancel
            telling.set()
            await told.wait()
        return "end_turn"

    turn = asyncio.create_task(session.run_turn(Working(work)))
    await eventually(lambda: session.turn_id == "t1", "the turn")
    session.cancel()
    await eventually(telling.is_set, "the server to be told")
    closing = asyncio.create_task(session.close())
    session.cancel()
    await asyncio.sleep(0)
    assert not turn.done()
    told.set()
    assert await turn == "cancelled"
    await closing


async def test_no_second_cancel_interrupts_a_turn_that_halts(session: Session) -> None:
    halting, at_rest = asyncio.Event(), asyncio.Event()

    async def work() -> str:
        await asyncio.Event().wait()
        return "end_turn"

    async def halt(_: BaseException) -> str:
        halting.set()
        await at_rest.wait()
        return "halted"

    turn = asyncio.create_task(session.run_turn(Working(work, halt)))
    await eventually(lambda: session.turn_id == "t1", "the turn")
    session.cancel()
    await eventually(halting.is_set, "the halt")
    session.cancel()
    assert session.turn_id == "t1", "the robot does not rest yet"
    at_rest.set()
    assert await turn == "halted"
    assert session.turn_id is None


async def test_a_cancel_reaches_the_turns_that_wait(session: Session) -> None:
    begun: list[str] = []

    def doing(name: str) -> Working:
        async def work() -> str:
            begun.append(name)
            await asyncio.Event().wait()
            return "end_turn"

        return Working(work, id=name)

    turns = [asyncio.create_task(session.run_turn(doing(name))) for name in ("first", "second")]
    await eventually(lambda: session.turn_id == "first", "the first turn")
    session.cancel()
    assert await asyncio.gather(*turns) == ["cancelled", "cancelled"]
    assert begun == ["first"]


async def test_a_turn_that_fails_halts_and_everybody_sees_that_it_is_over(session: Session) -> None:
    errors: list[BaseException] = []

    async def work() -> str:
        raise ValueError("unknown")

    async def halt(error: BaseException) -> str:
        errors.append(error)
        return "end_turn"

    assert await session.run_turn(Working(work, halt)) == "end_turn"
    assert [str(error) for error in errors] == ["unknown"]
    await session.flushed()
    [ended] = [event async for event in session._journal._store.events("s1")]
    assert ended.update["_meta"]["robot-acp/turn"] == {"id": "t1", "state": "ended", "stopReason": "end_turn"}
    assert not session.busy


class Robot(McpClient):
    """A robot that is lost in the middle of its first motion."""

    async def tools(self) -> dict[str, Tool]:
        return {"rotate_in_place": Tool("rotate_in_place", "Turn.", {}, "Turn", None, False)}

    async def call(self, *_: Any, **__: Any) -> ToolResult:
        raise ServerUnavailable("The robot does not answer.")


async def turning(*_: Any) -> AsyncIterator[model.Part]:
    yield model.Call("rotate_in_place", {"degrees": 90})


def at(speed: float) -> State:
    pose, battery = Pose(0.0, 0.0, 0.0), Battery(1.0, False)
    return State(0.0, "Sancho", pose, Twist(0.0, speed), battery, None, None, None)


async def test_the_robot_is_given_on_at_rest_when_a_turn_fails_in_mid_motion(session: Session) -> None:
    link, lease, tools = RobotClient(RobotServerClient(None)), Lease(), Robot("http://127.0.0.1:1/mcp", absent="")
    await link._set(at(0.5))
    environment = TurnEnvironment(
        "Sancho",
        tools,
        Policy(),
        link,
        session._journal._store,
        lease,
        1.0,
        5,
        1.0,
        infer=turning,
        audit=Audit(Path("/"), "agent"),
    )
    turn = asyncio.create_task(
        session.run_turn(Turn(environment, session, ANA, [{"type": "text", "text": "turn"}], None))
    )
    told = "The robot does not answer."
    await eventually(lambda: told in str(session.history.messages()) or turn.done(), "the failure to be told")
    await link._set(at(0.5))
    session.cancel()  # interrupts nothing
    await link._set(at(0.4))
    assert lease.holder is not None, "the next one gets a robot that moves"
    assert not turn.done()

    async def rests() -> None:
        while not turn.done():
            await link._set(at(0.0))
            await asyncio.sleep(0)

    async with asyncio.timeout(PATIENCE_S):
        await rests()
    assert await turn == "end_turn"
    assert lease.holder is None


async def test_a_robot_that_is_silent_on_an_open_line_does_not_count_as_one_at_rest() -> None:
    link = RobotClient(RobotServerClient(None))
    await link._set(at(0.5))
    rest = asyncio.create_task(link.at_rest())
    await asyncio.sleep(0)
    await link._fall_silent()
    later = asyncio.create_task(link.at_rest())
    await asyncio.sleep(0)
    await link._set(at(0.5))
    assert link.state is not None
    assert not rest.done()
    assert not later.done()
    await link._set(at(0.0))
    await asyncio.gather(rest, later)


class InMemory(McpClient):
    """The connection to a server of the SDK in this process."""

    def __init__(self, server: Server[Any]) -> None:
        super().__init__("http://127.0.0.1:1/mcp", absent="The robot does not answer.")
        self._server = server

    @contextlib.asynccontextmanager
    async def _transport(self) -> AsyncIterator[Any]:
        yield self._server


def careless(driving: asyncio.Event, arrived: asyncio.Event) -> Server[Any]:
    """A robot that drives, and whose other tool announces a number and returns none."""
    number = {"type": "object", "properties": {"volts": {"type": "number"}}, "required": ["volts"]}
    tools = [
        types.Tool(name="drive", input_schema={"type": "object"}),
        types.Tool(name="get_battery", input_schema={"type": "object"}, output_schema=number),
    ]

    async def list_tools(*_: Any) -> types.ListToolsResult:
        return types.ListToolsResult(tools=tools)

    async def call_tool(_: Any, params: types.CallToolRequestParams) -> types.CallToolResult:
        if params.name == "drive":
            driving.set()
            await arrived.wait()
            return types.CallToolResult(content=[types.TextContent(type="text", text="arrived")])
        content = types.TextContent(type="text", text="hunter2")
        return types.CallToolResult(content=[content], structured_content={"volts": "hunter2"})

    return Server("careless", on_list_tools=list_tools, on_call_tool=call_tool)


async def test_a_tool_that_answers_otherwise_than_announced_ends_nobody_elses_motion() -> None:
    driving, arrived = asyncio.Event(), asyncio.Event()
    robot = InMemory(careless(driving, arrived))
    drive = asyncio.create_task(robot.call("drive", {}))
    await eventually(driving.is_set, "the drive")
    battery = await robot.call("get_battery", {})
    assert battery.failed
    assert battery.text == "The tool's answer is not what it announced."
    arrived.set()
    assert (await drive).text == "arrived"
    await robot.close()
