"""Stop with a robot of somebody else: it reaches that robot or says that it could not, and never stops another one."""

from __future__ import annotations

import asyncio
import contextlib
import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from backend.chat.link import RefusedError
from backend.identity import Role
from tests.processes import Client, Robot, end, eventually, free_port, listens, wait_until

FOREIGN = Path(__file__).parent / "foreign_robot.py"
THIRD = Path(__file__).parent / "agent" / "third_party_robot.py"


@dataclass
class Foreign:
    """A robot of somebody else that runs, and a robot of ours whose agent drives that one."""

    file: Path
    port: int
    ours: Robot

    @property
    def noted(self) -> list[list[Any]]:
        return [json.loads(line) for line in self.file.read_text().splitlines()] if self.file.exists() else []

    def did(self, what: str) -> int:
        return sum(line[0] == what for line in self.noted)

    @property
    def stops(self) -> list[list[Any]]:
        return [line for line in self.noted if line[:2] == ["POST", "/stop"]]


@pytest.fixture(scope="module", params=["no-stop", "stop"])
def foreign(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Foreign]:
    """Such a robot without and with `/stop`, and our agent and bridge on it."""
    folder, port = tmp_path_factory.mktemp("foreign"), free_port()
    ours = Robot(folder / "data", {"ROBOT_ACP_AGENT__ROBOT_URL": f"http://127.0.0.1:{port}/mcp"})
    process = subprocess.Popen([sys.executable, str(FOREIGN), str(port), str(folder / "noted"), request.param])
    with contextlib.ExitStack() as running:
        running.callback(end, process)
        wait_until(lambda: listens(port), "the other robot")
        running.enter_context(ours.running("agent", port=ours.agent_port))
        running.enter_context(ours.running("bridge", port=ours.bridge_port))
        yield Foreign(folder / "noted", port, ours)


@pytest.fixture
def has_path(foreign: Foreign, request: pytest.FixtureRequest) -> bool:
    return bool(request.node.callspec.params["foreign"] == "stop")


@contextlib.asynccontextmanager
async def two_turns(foreign: Foreign):  # type: ignore[no-untyped-def]
    """Two people's sessions: the turn of one turns the robot, that of the other waits for the robot."""
    before = foreign.did("turning")
    clients = [await Client.open(f"tcp://127.0.0.1:{foreign.ours.agent_port}") for _ in range(2)]
    for client in clients:
        await client.new()
    turns = [clients[0].later(clients[0].prompt("turn left"))]
    await eventually(lambda: foreign.did("turning") > before, "the robot to turn")
    turns.append(clients[1].later(clients[1].prompt("turn right")))
    await eventually(lambda: "waiting for the robot" in str(clients[1].heard), "the other turn to wait")
    cancelled = foreign.did("cancelled")
    yield clients, turns
    await eventually(lambda: foreign.did("cancelled") == cancelled + 1, "the call to be cancelled at its server")
    assert [await turn for turn in turns] == ["cancelled", "cancelled"]
    for client in clients:
        await client.close()


async def test_the_agents_stop_cancels_every_turn_and_tells_the_truth(foreign: Foreign, has_path: bool) -> None:
    made = len(foreign.stops)
    async with two_turns(foreign) as (clients, _):
        if has_path:
            answer = await clients[1].link.request("_robot/stop", {})
            assert answer["stopped"]["at"] == 1.0
        else:
            with pytest.raises(RefusedError) as refused:
                await clients[1].link.request("_robot/stop", {})
            assert str(refused.value) == (
                "This robot has no stop path here, so it was not stopped. All 2 turns were cancelled, and with them "
                "their calls to the robot. Use the stop button on the robot."
            )
    assert len(foreign.stops) == made + 1


async def test_the_command_stop_in_a_prompt_tells_the_same(foreign: Foreign, has_path: bool) -> None:
    async with two_turns(foreign) as (clients, _):
        await clients[1].prompt("/stop")
        said = clients[1].said
    assert "I am stopped" not in said
    if has_path:
        assert "The robot's own server says that the robot is stopped. Every turn was cancelled." in said
    else:
        assert "it was not stopped. All 2 turns were cancelled" in said
        assert "Use the stop button on the robot." in said


async def test_a_browsers_stop_tells_the_same(foreign: Foreign, has_path: bool) -> None:
    bearer = {"Authorization": f"Bearer {foreign.ours.token('Vera', Role.VIEWER)}"}
    base = f"http://127.0.0.1:{foreign.ours.bridge_port}"
    async with two_turns(foreign), httpx.AsyncClient(base_url=base, headers=bearer, trust_env=False) as http:
        answer = await http.post("/api/stop", timeout=30)
        health = (await http.get("/api/health", timeout=30)).json()
    assert health["robot"] == {"up": True, "detail": f"An MCP server at http://127.0.0.1:{foreign.port}."}
    if has_path:
        assert (answer.status_code, answer.json()) == (200, {"stopped": {"by": "Vera", "at": 1.0}})
    else:
        assert answer.status_code == 503
        assert answer.json()["error"].startswith("This robot has no stop path here, so it was not stopped.")
        assert "All 2 turns were cancelled" in answer.json()["error"]
        assert "stopped" not in answer.json()


async def test_the_terminals_stop_tells_the_same(foreign: Foreign, has_path: bool) -> None:
    async with two_turns(foreign):
        chat = foreign.ours.spawn("chat", stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert chat.stdin is not None
        assert chat.stdout is not None
        print("/stop", file=chat.stdin, flush=True)
        chat.stdin.close()
        said = await asyncio.to_thread(chat.stdout.read)
        end(chat)
    assert ("Stopped by" if has_path else "it was not stopped. All 2 turns were cancelled") in said
    assert has_path == ("Stopped by" in said)


async def test_nothing_of_ours_is_sent_to_it(foreign: Foreign, has_path: bool) -> None:
    async with two_turns(foreign) as (clients, _):
        with contextlib.suppress(RefusedError):
            await clients[0].link.request("_robot/stop", {})
    secret = foreign.ours.robot_headers["Authorization"].removeprefix("Bearer ")
    assert len(foreign.noted) > 5
    assert secret not in foreign.file.read_text()
    for _, _, query, authorization in foreign.stops:
        assert authorization == ""
        assert query.startswith("by=")
    if has_path:
        assert json.loads(next(line[2] for line in foreign.noted if line[:2] == ["body", "/stop"]))["by"]


def test_the_doctor_looks_at_the_robot_that_is_driven(foreign: Foreign) -> None:
    doctor = foreign.ours.spawn("doctor", stdout=subprocess.PIPE)
    assert doctor.stdout is not None
    said = doctor.stdout.read()
    end(doctor)
    assert f"robot: An MCP server at http://127.0.0.1:{foreign.port}." in said
    assert f"127.0.0.1:{foreign.ours.robot_port}" not in said


async def test_a_robot_behind_a_command_has_no_stop_and_everybody_is_told(tmp_path: Path) -> None:
    robot = Robot(tmp_path, {"ROBOT_ACP_AGENT__ROBOT_URL": f"stdio:{sys.executable} {THIRD}"})
    with robot.running("agent", port=robot.agent_port), robot.running("bridge", port=robot.bridge_port):
        client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}", answer=None)
        await client.new()
        turn = client.later(client.prompt("say hello"))
        await eventually(lambda: client.questions, "the question")
        bearer = {"Authorization": f"Bearer {robot.token('Vera', Role.VIEWER)}"}
        base = f"http://127.0.0.1:{robot.bridge_port}"
        async with httpx.AsyncClient(base_url=base, headers=bearer, trust_env=False, timeout=30) as http:
            answer = await http.post("/api/stop")
            assert answer.status_code == 503
            assert answer.json() == {
                "error": "This robot has no stop path here, so it was not stopped. The turn that ran was cancelled, "
                "and with it its call to the robot. Use the stop button on the robot."
            }
            assert await turn == "cancelled"
            health = (await http.get("/api/health")).json()
            assert health["robot"] == {
                "up": True,
                "detail": "Only the agent reaches this robot: it is behind a command.",
            }
            assert (await http.post("/api/release")).status_code == 403
        await client.close()


async def test_a_stop_that_our_own_robot_server_does_not_take_cancels_every_turn(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    with robot.running("agent", port=robot.agent_port):
        with robot.running("robot", port=robot.robot_port):
            client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}", answer=None)
            await client.new()
            turn = client.later(client.prompt("say hello"))
            await eventually(lambda: client.questions, "the question")
        with pytest.raises(RefusedError, match=r"reached to stop it\. The turn that ran was cancelled"):
            await client.link.request("_robot/stop", {})
        assert await turn == "cancelled"
        await client.close()
