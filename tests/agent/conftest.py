"""A real robot server, fast, and a real agent on it, each in its own process."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from typing import Any

import pytest

from tests.databases import database, impatient, postgres  # noqa: F401 - fixtures
from tests.processes import Client, Robot

TIME_SCALE = "20"


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """Robot server and agent at work."""
    robot = Robot(tmp_path_factory.mktemp("data"), {"ROBOT_ACP_AGENT__PERMISSION_TIMEOUT": "2"})
    with (
        robot.running("robot", "--time-scale", TIME_SCALE, port=robot.robot_port),
        robot.running("agent", port=robot.agent_port),
    ):
        yield robot


Opener = Callable[..., Awaitable[Client]]


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
