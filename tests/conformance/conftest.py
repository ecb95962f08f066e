"""A real robot server, fast, a real agent and a real bridge on it, and one connection for each transport."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import AsyncExitStack
from typing import Any

import pytest
import pytest_asyncio

from tests.conformance.cases import operations_of, seen_in
from tests.conformance.channels import TRANSPORTS
from tests.conformance.recorded_client import RecordedClient, choose
from tests.processes import Robot

TIME_SCALE = "20"


@pytest.fixture(scope="package")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """Robot server, agent and bridge at work."""
    robot = Robot(tmp_path_factory.mktemp("data"))
    with (
        robot.running("robot", "--time-scale", TIME_SCALE, port=robot.robot_port),
        robot.running("agent", port=robot.agent_port),
        robot.running("bridge", port=robot.bridge_port),
    ):
        yield robot


@pytest_asyncio.fixture(scope="module", loop_scope="module", params=list(TRANSPORTS))
async def connection(robot: Robot, request: pytest.FixtureRequest) -> AsyncIterator[RecordedClient]:
    """One connection for all cases, as a client in the field keeps it: so they also show that it stays good."""
    async with RecordedClient.open(robot, request.param) as client:
        yield client


Opener = Callable[[dict[str, Any]], Awaitable[RecordedClient]]


@pytest_asyncio.fixture(loop_scope="module")
async def client(
    connection: RecordedClient, others: list[RecordedClient], request: pytest.FixtureRequest
) -> AsyncIterator[RecordedClient]:
    """The connection, with a client that allows what it is asked, and nothing heard yet.

    After the case: every frame followed the schema, and the case has shown what it says that it shows.
    """
    connection.log.clear()
    connection.forgotten.clear()
    connection.answers = {"session/request_permission": choose("allow_once")}
    connection.session = ""
    yield connection
    clients = [connection, *others]
    assert [violation for client in clients for violation in client.violations] == []
    seen = {operation for client in clients for operation in seen_in(client.forgotten + client.log)}
    assert set(operations_of(request.function)) - seen == set()


@pytest_asyncio.fixture(loop_scope="module")
async def others() -> list[RecordedClient]:
    """The clients that a case opened for itself."""
    return []


@pytest_asyncio.fixture(loop_scope="module")
async def another(robot: Robot, connection: RecordedClient, others: list[RecordedClient]) -> AsyncIterator[Opener]:
    """Opens further clients on the same transport, with other capabilities."""
    async with AsyncExitStack() as opened:

        async def one_more(capabilities: dict[str, Any]) -> RecordedClient:
            client = await opened.enter_async_context(RecordedClient.open(robot, connection.transport, capabilities))
            others.append(client)
            return client

        yield one_more
