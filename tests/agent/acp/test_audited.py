"""Agent and robot server tell the audit log who logged in, was refused, stopped, released, allowed and changed what."""

from __future__ import annotations

import asyncio
import fcntl
import os
from typing import Any

import httpx
import pytest

from backend import audit
from backend.chat.link import RefusedError
from backend.identity import Role
from tests.agent.conftest import Opener, holds_the_robot
from tests.processes import Robot, eventually


def events(robot: Robot, event: str, **wanted: object) -> list[dict[str, Any]]:
    return [
        entry
        for entry in audit.entries(robot.data)
        if entry["event"] == event and all(entry.get(name) == value for name, value in wanted.items())
    ]


async def one(robot: Robot, event: str, **wanted: object) -> dict[str, Any]:
    """The event, once it is in the log; it must be the only one of its kind."""
    found = await eventually(lambda: events(robot, event, **wanted), f"{event} in the audit log")
    assert len(found) == 1
    return dict(found[0])


async def test_logins_refusals_and_logouts_are_in_the_log(robot: Robot, connect: Opener) -> None:
    client = await connect(robot.token("Lea", Role.OPERATOR))
    login = await one(robot, "login", by="Lea")
    assert (login["process"], login["role"], login["address"]) == ("agent", "operator", "127.0.0.1")
    assert len(login["token"]) == 12
    with pytest.raises(RefusedError):
        await client.link.request("authenticate", {"methodId": "token", "_meta": {"robot-acp/token": "a.forged.one"}})
    refused = await one(robot, "login_refused")
    assert "by" not in refused
    assert refused["address"] == "127.0.0.1"
    assert "forged" not in str(refused)
    await client.link.request("logout", {})
    assert (await one(robot, "logout", by="Lea"))["token"] == login["token"]
    assert await eventually(lambda: events(robot, "login", by="local", token=None), "the client without a token")


async def test_whoever_stops_and_releases_is_in_the_log_of_agent_and_robot(robot: Robot, connect: Opener) -> None:
    vera, sue = [await connect(robot.token(*who)) for who in (("Vera", Role.VISITOR), ("Sue", Role.SUPERVISOR))]
    try:
        await vera.link.request("_robot/stop", {})
        by_agent = await one(robot, "stop", process="agent", by="Vera")
        assert (by_agent["role"], by_agent["confirmed"]) == ("visitor", True)
        by_robot = await one(robot, "stop", process="robot", by="Vera")
        assert by_robot["via"] == "HTTP"
        with pytest.raises(RefusedError):
            await vera.link.request("_robot/release", {})
        await vera.new()
        await vera.prompt("/stop")
        await eventually(lambda: len(events(robot, "stop", process="agent", by="Vera")) == 2, "the second stop")
        assert not events(robot, "release", by="Vera")
    finally:
        await sue.link.request("_robot/release", {})
    assert (await one(robot, "release", process="agent", by="Sue"))["role"] == "supervisor"
    assert (await one(robot, "release", process="robot", by="Sue"))["via"] == "HTTP"


async def test_a_log_that_cannot_be_written_delays_no_stop(robot: Robot, connect: Opener) -> None:
    lea, sue = [await connect(robot.token(*who)) for who in (("Lea2", Role.VISITOR), ("Sue4", Role.SUPERVISOR))]
    folder = os.open(robot.data, os.O_RDONLY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX)  # whoever writes waits for it
        await lea.link.request("_robot/stop", {})
        await sue.link.request("_robot/release", {})
        assert not await asyncio.to_thread(lines_of, robot, "Lea2")
    finally:
        os.close(folder)
    for process in ("agent", "robot"):
        await one(robot, "stop", process=process, by="Lea2")
        await one(robot, "release", process=process, by="Sue4")


def lines_of(robot: Robot, name: str) -> list[str]:
    """The stops of a person in the log, read without its lock."""
    lines = (robot.data / audit.FILE).read_text().splitlines()
    return [line for line in lines if f'"{name}"' in line and '"stop"' in line]


async def test_a_stop_over_http_has_the_name_of_its_body(robot: Robot) -> None:
    async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{robot.robot_port}", headers=robot.robot_headers) as http:
        await http.post("/stop", json={"by": "Bo\u202edy"})
        await http.post("/release", json={"by": "Releaser"})
    assert (await one(robot, "release", by="Releaser"))["process"] == "robot"
    assert await one(robot, "stop", by="Body")


async def test_modes_permissions_and_deletions_say_who_and_what(robot: Robot, connect: Opener) -> None:
    ana = await connect(robot.token("Ana", Role.OPERATOR))
    ana.answer = "reject_once"
    session = await ana.new()
    for _ in range(2):  # the second one changes nothing
        await ana.link.request("session/set_mode", {"sessionId": session, "modeId": "observe"})
    await ana.link.request(
        "session/set_config_option", {"sessionId": session, "configId": "mode", "value": "supervised"}
    )
    first = await one(robot, "mode_changed", by="Ana", new="observe")
    assert (first["session"], first["old"]) == (session, "supervised")
    assert (await one(robot, "mode_changed", by="Ana", new="supervised"))["old"] == "observe"
    await ana.prompt("say hello")
    said_no = await one(robot, "permission", session=session)
    assert (said_no["by"], said_no["role"], said_no["tool"], said_no["answer"], said_no["asked_by"]) == (
        "Ana", "operator", "speak", "reject_once", "Ana",
    )  # fmt: skip
    assert said_no["token"] == said_no["asked_by_token"]
    sue = await connect(robot.token("Sue2", Role.SUPERVISOR))
    await sue.link.request("session/delete", {"sessionId": session})
    deleted = await one(robot, "session_deleted", session=session)
    assert (deleted["by"], deleted["owner"]) == ("Sue2", "Ana")


async def test_a_question_that_a_visitor_caused_names_both(robot: Robot, connect: Opener) -> None:
    vic = await connect(robot.token("Vic", Role.VISITOR))
    otto = await connect(robot.token("Otto", Role.OPERATOR))
    session = await vic.new()
    await otto.load(session)
    await vic.prompt("say hello")
    allowed = await one(robot, "permission", session=session)
    assert (allowed["by"], allowed["answer"], allowed["asked_by"]) == ("Otto", "allow_once", "Vic")


async def test_a_takeover_names_both(robot: Robot, connect: Opener) -> None:
    ben = await connect(robot.token("Ben", Role.OPERATOR), answer=None)
    sue = await connect(robot.token("Sue3", Role.SUPERVISOR))
    turn = await holds_the_robot(ben)
    await sue.link.request("_robot/take_over", {})
    await asyncio.wait_for(turn, 30)
    taken = await one(robot, "take_over")
    assert (taken["by"], taken["taken_from"], taken["session"]) == ("Sue3", "Ben", ben.session)
