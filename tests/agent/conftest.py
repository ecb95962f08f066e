"""A real robot server, fast, and a real agent on it, each in its own process."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from tests.databases import database, impatient, postgres  # noqa: F401 - fixtures
from tests.processes import Client, Robot, Watched, eventually

TIME_SCALE = "20"


def far_place(watched: Watched) -> str:
    """A place to which the robot drives for a while, wherever it is now."""
    return "lab 2.3.9" if watched.distance_to(21.0, 4.0) > 8.0 else "the kitchen"


def far(watched: Watched) -> str:
    """A prompt to drive for a while."""
    return f"go to {far_place(watched)} and then come back"


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """Robot server and agent at work."""
    robot = Robot(tmp_path_factory.mktemp("data"))
    with (
        robot.running("robot", "--time-scale", TIME_SCALE, port=robot.robot_port),
        robot.running("agent", port=robot.agent_port),
    ):
        yield robot


Opener = Callable[..., Awaitable[Client]]


async def holds_the_robot(client: Client) -> asyncio.Task[str]:
    """A turn in a session of the client's that has the robot until its question is answered, or it is cancelled."""
    await client.new()
    turn: asyncio.Task[str] = client.later(client.prompt("say hello"))
    await eventually(lambda: client.questions, "the question")
    return turn


@asynccontextmanager
async def client_of_an_impatient_agent(robot: Robot, **options: Any) -> AsyncIterator[Client]:
    """A client with a session at an agent of its own, which waits for people half a second only."""
    hasty = robot.with_another_agent({"ROBOT_ACP_AGENT__PERMISSION_TIMEOUT": "0.5"})
    with hasty.running("agent", port=hasty.agent_port):
        client = await Client.open(f"tcp://127.0.0.1:{hasty.agent_port}", **options)
        await client.new()
        yield client
        await client.close()


@pytest.fixture
async def connect(robot: Robot) -> AsyncIterator[Opener]:
    """Opens clients of the agent over TCP; they are closed at the end."""
    clients: list[Client] = []

    async def opened(role_token: str | None = None, **options: Any) -> Client:
        client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}", **options)
        if role_token is not None:
            await client.link.request("authenticate", {"methodId": "token", "_meta": {"robot-acp/token": role_token}})
        clients.append(client)
        return client

    yield opened
    for client in clients:
        await client.close()
