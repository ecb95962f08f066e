"""While the database is away, everybody is told so, and all that needs no log goes on."""

from __future__ import annotations

import asyncio
import subprocess
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest

from backend.chat.link import RefusedError
from backend.identity import Role
from tests.databases import Cluster, PostgreSQL
from tests.processes import PATIENCE_S, Client, Process, Robot, eventually

TELEMETRY = {"_meta": {"robot-acp/telemetry": {"rate": 10}}}


@asynccontextmanager
async def agent_with(robot: Robot, database: PostgreSQL) -> AsyncIterator[Robot]:
    own = robot.with_another_agent({"ROBOT_ACP_AGENT__DATABASE": database.url})
    with own.running("agent", port=own.agent_port):
        yield own


async def opened(robot: Robot, role: Role = Role.SUPERVISOR) -> Client:
    client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}", capabilities=TELEMETRY)
    token = {"robot-acp/token": robot.token("Olga", role)}
    await client.link.request("authenticate", {"methodId": "token", "_meta": token})
    return client


def newest(client: Client) -> dict[str, Any]:
    found = [m["params"] for m in client.heard if m["method"] == "_robot/telemetry"]
    return found[-1] if found else {}


async def test_new_and_old_clients_are_told_and_stop_works(postgres: Cluster, robot: Robot) -> None:
    with postgres.new_database() as database:
        async with agent_with(robot, database) as own:
            watching = await opened(own)
            session = await watching.new()
            await watching.prompt("/where")
            await eventually(lambda: newest(watching).get("online"), "telemetry")
            assert newest(watching)["database"] is None
            with database.away():
                await eventually(lambda: newest(watching).get("database"), "telemetry to say it")
                away = newest(watching)["database"]
                assert "The session log cannot be written" in away["text"]
                assert away["at"] > 1e9
                late = await opened(own)
                await eventually(lambda: newest(late).get("database"), "a new page to be told")
                assert newest(late)["online"]
                for method, params in (
                    ("session/list", {}),
                    ("session/new", {"cwd": "/", "mcpServers": []}),
                    ("session/load", {"sessionId": "unknown", "cwd": "/", "mcpServers": []}),
                    ("session/load", {"sessionId": session, "cwd": "/", "mcpServers": []}),
                    ("session/fork", {"sessionId": session, "cwd": "/", "mcpServers": []}),
                    ("session/delete", {"sessionId": session}),
                    ("_robot/events", {"sessionId": session}),
                    (
                        "session/prompt",
                        {"sessionId": session, "prompt": [{"type": "text", "text": "where are you?"}]},
                    ),
                ):
                    with pytest.raises(RefusedError) as refused:
                        await late.link.request(method, params)
                    assert refused.value.database_away, f"{method}: {refused.value}"
                    assert "doctor" in str(refused.value)
                    assert "Something went wrong" not in str(refused.value)
                await late.link.request("session/resume", {"sessionId": session, "cwd": "/", "mcpServers": []})
                await late.link.request("_robot/leave", {"sessionId": "unknown"})
                stop = [{"type": "text", "text": "/stop"}]
                with pytest.raises(RefusedError, match=r"I am stopped.*database"):
                    await late.link.request("session/prompt", {"sessionId": "unknown", "prompt": stop})
                assert (await robot.state()).stop is not None
                await late.link.request("_robot/release", {})
            await eventually(lambda: newest(late)["database"] is None, "telemetry to say that it is back")
            assert await watching.prompt("where are you?") == "end_turn"
            async with asyncio.timeout(PATIENCE_S):
                await late.load(session)
            await watching.close()
            await late.close()


async def test_a_new_terminal_is_told_stops_the_robot_and_begins_when_the_database_is_back(
    postgres: Cluster, robot: Robot
) -> None:
    with postgres.new_database() as database:
        async with agent_with(robot, database) as own:
            with database.away():
                process = own.spawn(
                    "chat",
                    "--telemetry",
                    "--token",
                    own.token("Olga", Role.SUPERVISOR),
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                )
                assert process.stdin is not None
                assert process.stdout is not None
                await line_of(process, lambda line: "the session log is away, no task can begin" in line)
                process.stdin.write("/stop\n/release\n")
                process.stdin.flush()
                await line_of(process, lambda line: "Released." in line)
            await line_of(process, lambda line: "battery" in line and "session log is away" not in line)
            process.stdin.write("where are you?\n")
            process.stdin.close()
            await line_of(process, lambda line: "I am at x" in line)
            assert await asyncio.to_thread(process.wait, PATIENCE_S) == 0


async def line_of(process: Process, wanted: Callable[[str], bool]) -> str:
    """The next line of the terminal that is wanted."""
    assert process.stdout is not None
    seen = []
    while not wanted(line := await asyncio.to_thread(process.stdout.readline)):
        seen.append(line)
        assert line, f"the terminal ended: {seen}"
    return line


async def test_the_doctor_sees_it(postgres: Cluster, robot: Robot) -> None:
    with postgres.new_database() as database:
        own = robot.with_another_agent({"ROBOT_ACP_AGENT__DATABASE": database.url})

        def doctor() -> str:
            done = subprocess.run(own.command("doctor"), env=own.variables, text=True, capture_output=True, check=False)
            return done.stdout

        assert "ok       database: it answers" in await asyncio.to_thread(doctor)
        with database.away():
            found = await asyncio.to_thread(doctor)
        assert "missing  database: The database of sessions cannot be used" in found
        assert "Connection refused" in found
        assert "hunter2" not in found
