"""Who is connected: told to those who may operate the robot and asked, when it changes, and at most once a second."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from backend import tokens
from backend.agent.acp.people import EVERY_S
from backend.identity import Role
from tests.agent.conftest import Opener
from tests.processes import Client, Robot, eventually

ASKS = {"_meta": {"robot-acp/people": True}}
CROWD = 200

Person = dict[str, Any]


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """An agent without its robot, for which nobody is anybody before the login."""
    robot = Robot(tmp_path_factory.mktemp("data"), {"ROBOT_ACP_AGENT__TRUST_LOOPBACK": "false"})
    with robot.running("agent", port=robot.agent_port):
        yield robot


def told(client: Client) -> list[list[Person]]:
    """All that a client was told of who is there."""
    return [message["params"]["people"] for message in client.heard if message["method"] == "_robot/people"]


def here(client: Client, name: str) -> Person | None:
    """Somebody as the client was told last."""
    return next((person for person in (told(client) or [[]])[-1] if person["name"] == name), None)


async def sees(client: Client, name: str, **expected: object) -> None:
    """Wait until the client is told this of somebody."""

    def seen() -> bool:
        person = here(client, name)
        return person is not None and expected.items() <= person.items()

    await eventually(seen, f"{name} with {expected}; told: {told(client)[-1:]}")


async def misses(client: Client, name: str) -> None:
    """Wait until the client is told that somebody is gone."""
    await eventually(lambda: here(client, name) is None, f"{name} to be gone")


@pytest.fixture
async def sue(robot: Robot, connect: Opener) -> Client:
    """A supervisor who asked to be told."""
    return await connect(robot.token("Sue", Role.SUPERVISOR), capabilities=ASKS)


async def test_everyone_who_is_logged_in_is_told_with_the_role(robot: Robot, connect: Opener, sue: Client) -> None:
    await connect(robot.token("Kiosk", Role.VISITOR))
    await connect(robot.token("Vic", Role.VIEWER))
    await connect(robot.token("Ben", Role.OPERATOR))
    await connect()  # and logs in as nobody
    everyone = {"Sue": "supervisor", "Kiosk": "visitor", "Vic": "viewer", "Ben": "operator"}
    for name, role in everyone.items():
        await sees(sue, name, role=role, connections=1, sessions=[])
    assert len(told(sue)[-1]) == len(everyone)


async def test_a_person_with_two_screens_is_one_person(robot: Robot, connect: Opener, sue: Client) -> None:
    first = await connect(robot.token("Ana", Role.OPERATOR))
    second = await connect(robot.token("Ana", Role.OPERATOR))
    await sees(sue, "Ana", connections=2)
    sessions = [await first.new(), await first.new(), await second.new()]
    await sees(sue, "Ana", sessions=[sessions[1], sessions[0], sessions[2]])
    await second.close()
    await sees(sue, "Ana", connections=1, sessions=[sessions[1], sessions[0]])
    await first.load(sessions[0])
    await sees(sue, "Ana", sessions=[sessions[0], sessions[1]])
    await first.link.request("_robot/leave", {"sessionId": sessions[0]})
    await sees(sue, "Ana", sessions=[sessions[1]])
    await first.link.request("session/delete", {"sessionId": sessions[1]})
    await sees(sue, "Ana", sessions=[])


async def test_the_same_name_in_another_role_is_somebody_else(robot: Robot, connect: Opener, sue: Client) -> None:
    await connect(robot.token("Sue", Role.VISITOR))
    both = [("Sue", "supervisor"), ("Sue", "visitor")]
    await eventually(lambda: [(p["name"], p["role"]) for people in told(sue)[-1:] for p in people] == both, "both")


async def test_whoever_leaves_logs_out_or_is_sent_away_disappears(robot: Robot, connect: Opener, sue: Client) -> None:
    leaving, logging_out, revoked, expiring = [
        await connect(robot.token(name, Role.VISITOR, seconds))
        for name, seconds in (("Lea", 3600), ("Lou", 3600), ("Rex", 3600), ("Exa", 10))
    ]
    await sees(sue, "Exa")
    for name in ("Lea", "Lou", "Rex"):
        await sees(sue, name)
    await leaving.close()
    await misses(sue, "Lea")
    await logging_out.link.request("logout", {})
    await misses(sue, "Lou")
    tokens.revoke(robot.data, "Rex")
    await misses(sue, "Rex")
    await misses(sue, "Exa")
    for client in (revoked, expiring):
        await eventually(client.link.closed.done, "the connection to end")
    assert not logging_out.link.closed.done()


async def test_only_who_may_operate_and_asked_is_told(robot: Robot, connect: Opener, sue: Client) -> None:
    ben = await connect(robot.token("Ben", Role.OPERATOR), capabilities=ASKS)
    strangers = [
        await connect(robot.token("Vic", Role.VIEWER), capabilities=ASKS),
        await connect(robot.token("Kiosk", Role.VISITOR), capabilities=ASKS),
        await connect(robot.token("Old", Role.SUPERVISOR)),
        await connect(robot.token("Odd", Role.SUPERVISOR), capabilities={"_meta": {"robot-acp/people": "yes"}}),
    ]
    for watcher in (sue, ben):
        for name in ("Vic", "Kiosk", "Old", "Odd", "Ben"):
            await sees(watcher, name)
    before = len(told(sue))
    await connect(robot.token("Late", Role.VISITOR))
    await eventually(lambda: len(told(sue)) > before, "the news")
    for stranger in strangers:
        await stranger.link.request("session/list", {})
        assert told(stranger) == []


async def test_who_changes_to_a_lesser_role_is_told_no_more(robot: Robot, connect: Opener, sue: Client) -> None:
    changing = await connect(robot.token("Cleo", Role.OPERATOR), capabilities=ASKS)
    await sees(changing, "Sue")
    token = robot.token("Cleo", Role.VISITOR)
    await changing.link.request("authenticate", {"methodId": "token", "_meta": {"robot-acp/token": token}})
    before = len(told(changing))
    await connect(robot.token("Late", Role.VISITOR))
    await sees(sue, "Late")
    await changing.link.request("session/list", {})
    assert len(told(changing)) == before


async def test_nothing_is_told_while_nothing_changes(robot: Robot, connect: Opener, sue: Client) -> None:
    await eventually(lambda: [p["name"] for people in told(sue)[-1:] for p in people] == ["Sue"], "Sue to be alone")
    before = len(told(sue))
    ben = await connect(robot.token("Ben", Role.OPERATOR), capabilities=ASKS)
    await sees(ben, "Ben")
    await ben.close()
    await misses(sue, "Ben")
    assert len(told(sue)) == before + 2


@asynccontextmanager
async def crowd(robot: Robot) -> AsyncIterator[list[Client]]:
    """Many operators who all asked to be told."""
    token = robot.token("Crowd", Role.OPERATOR)
    address = f"tcp://127.0.0.1:{robot.agent_port}"
    people: list[Client] = []
    try:
        for _ in range(CROWD):
            client = await Client.open(address, capabilities=ASKS)
            people.append(client)
            await client.link.request("authenticate", {"methodId": "token", "_meta": {"robot-acp/token": token}})
        yield people
    finally:
        await asyncio.gather(*(client.close() for client in people))


async def test_a_crowd_is_told_at_most_once_a_second(robot: Robot, sue: Client) -> None:
    began = time.monotonic()
    async with crowd(robot) as people:
        for client in (people[0], people[-1], sue):
            await sees(client, "Crowd", connections=CROWD)
        session = await people[0].new()
        await sees(people[-1], "Crowd", sessions=[session])
        most = (time.monotonic() - began) / EVERY_S + 1
        for client in people:
            assert len(told(client)) <= most
    await misses(sue, "Crowd")
