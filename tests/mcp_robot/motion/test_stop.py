"""Stop: over its own HTTP path, at once, latched, remembered, and released without moving anything."""

from __future__ import annotations

import asyncio
import math
import signal
from pathlib import Path

import httpx
import pytest

from backend.mcp_robot.motion.stop import FILE
from tests.mcp_robot.conftest import Served, serving
from tests.mcp_robot.tools.test_tools import AT_ONCE, call, refused
from tests.processes import Robot, end


async def test_a_stop_brakes_ends_the_motion_with_its_name_and_refuses_new_ones(tmp_path: Path) -> None:
    async with (
        serving(tmp_path, time_scale=1.0) as robot,
        robot.mcp() as client,
        robot.http() as http,
        robot.telemetry("state", rate=50) as reader,
    ):
        driving = asyncio.create_task(client.call_tool("navigate_to_place", {"place": "lab 2.3.7"}))
        await reader.state(lambda s: s.twist.linear > 0.4)
        answer = await http.post("/stop", params={"by": "Ana"})
        assert answer.json()["stopped"]["by"] == "Ana"
        stopped = await reader.state(lambda s: s.stop is not None)
        halted = await reader.state(lambda s: s.twist.linear == 0)
        assert math.dist((halted.pose.x, halted.pose.y), (stopped.pose.x, stopped.pose.y)) < AT_ONCE
        result = await driving
        assert result.is_error
        assert result.content[0].text == "stopped: Stopped by Ana. A supervisor has to release it."  # type: ignore[union-attr]
        for tool, arguments in (
            ("navigate_to_place", {"place": "dock"}),
            ("navigate_to_pose", {"x": 3, "y": 3}),
            ("rotate_in_place", {"degrees": 10}),
            ("speak", {"text": "Hello"}),
        ):
            assert await refused(client, tool, **arguments) == (
                "stopped: Stopped by Ana. A supervisor has to release it."
            )
        status = await call(client, "get_robot_status")
        assert status["mode"] == "stopped"
        assert status["stopped"]["by"] == "Ana"
        assert (await call(client, "navigate_to_place", place="dock", plan_only=True))["path_length"] > 0


async def test_release_allows_motion_again_and_starts_none(robot: Served) -> None:
    async with robot.mcp() as client, robot.http() as http, robot.telemetry("state") as reader:
        await http.post("/stop", params={"by": "Ana"})
        await reader.state(lambda s: s.stop is not None)
        assert (await http.post("/release", params={"by": "Ben"})).json() == {"stopped": None}
        pose = (await reader.state(lambda s: s.stop is None)).pose
        for _ in range(5):
            assert (await reader.state()).pose == pose
        assert (await call(client, "rotate_in_place", degrees=10))["reached"]


async def test_the_first_stop_is_kept(robot: Served) -> None:
    async with robot.http() as http:
        first = (await http.post("/stop", params={"by": "Ana"})).json()
        assert (await http.post("/stop", params={"by": "Ben"})).json() == first


async def test_a_stop_outlives_the_robot_server(tmp_path: Path) -> None:
    async with serving(tmp_path) as robot, robot.http() as http:
        await http.post("/stop", params={"by": "Ana"})
    async with serving(tmp_path) as robot, robot.mcp() as client, robot.http() as http:
        assert (await refused(client, "rotate_in_place", degrees=10)).startswith("stopped: Stopped by Ana.")
        await http.post("/release", params={"by": "Ana"})
    async with serving(tmp_path) as robot, robot.mcp() as client:
        assert (await call(client, "rotate_in_place", degrees=10))["reached"]


async def test_a_stop_outlives_a_robot_server_that_was_killed(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    url = f"http://127.0.0.1:{robot.robot_port}"
    with robot.running("robot", port=robot.robot_port) as process:
        async with httpx.AsyncClient(base_url=url, headers=robot.robot_headers) as http:
            assert (await http.post("/stop", params={"by": "Ana"})).json()["stopped"]["by"] == "Ana"
        end(process, signal.SIGKILL)
    with robot.running("robot", port=robot.robot_port):
        async with robot.watched() as watched:
            assert watched.state.stop is not None
            assert watched.state.stop.by == "Ana"


async def test_with_a_stop_file_that_was_spoilt_it_starts_stopped_and_can_be_released(tmp_path: Path) -> None:
    (tmp_path / FILE).write_bytes(b'{"by": "An')
    async with serving(tmp_path) as robot, robot.mcp() as client, robot.http() as http:
        text = await refused(client, "rotate_in_place", degrees=10)
        assert text.startswith("stopped: Stopped by an unreadable stop file.")
        await http.post("/release", params={"by": "Ana"})
        assert (await call(client, "rotate_in_place", degrees=10))["reached"]
    assert not (tmp_path / FILE).exists()


@pytest.mark.parametrize("query", ["", "?", "?by=", "?by=%FF%00", "?by=%20%0a", "?" + "&" * 20_000, "?%%%", "?by"])
async def test_a_stop_is_never_refused_for_its_form(robot: Served, query: str) -> None:
    async with robot.http() as http:
        answer = await http.post(f"/stop{query}", content=b"{" * 200_000)
        assert answer.status_code == 200
        assert answer.json()["stopped"]["by"] in ("someone", "\N{REPLACEMENT CHARACTER}")


@pytest.mark.parametrize(
    ("query", "body", "name"),
    [
        ("", b'{"by": "Ana"}', "Ana"),
        ("", b'{"by": "  Ana\\u202e\\n Maria ", "more": [1]}', "Ana Maria"),
        ("?by=Ana", b'{"by": "Ben"}', "Ana"),
        ("?by=", b'{"by": "Ben"}', "Ben"),
        ("", b'{"by": "' + b"x" * 200 + b'"}', "x" * 80),
        ("", b'{"by": "' + b"x" * 5000 + b'"}', "someone"),
        ("", b'{"by": 7}', "someone"),
        ("", b'{"by": null}', "someone"),
        ("", b'["Ana"]', "someone"),
        ("", b"\xff\xfe", "someone"),
        ("", b"[" * 4000, "someone"),
        ("", b"", "someone"),
    ],
)
async def test_the_name_may_be_in_the_body(robot: Served, query: str, body: bytes, name: str) -> None:
    async with robot.http() as http, robot.telemetry("state") as reader:
        for path in ("/stop", "/release"):
            answer = await http.post(path + query, content=body)
            assert answer.status_code == 200
            if path == "/stop":
                assert answer.json()["stopped"]["by"] == name
                state = await reader.state(lambda s: s.stop is not None)
                assert state.stop is not None
                assert state.stop.by == name


async def test_a_second_stop_names_nobody_anew(robot: Served) -> None:
    async with robot.http() as http:
        first = (await http.post("/stop")).json()
        assert first["stopped"]["by"] == "someone"
        assert (await http.post("/stop", json={"by": "Ben"})).json() == first


async def test_a_named_stop_is_remembered_with_its_name(tmp_path: Path) -> None:
    async with serving(tmp_path) as robot, robot.http() as http:
        await http.post("/stop", json={"by": "Ana"})
    async with serving(tmp_path) as robot, robot.mcp() as client:
        assert (await refused(client, "rotate_in_place", degrees=10)).startswith("stopped: Stopped by Ana.")


async def test_a_stop_does_not_wait_for_the_body_that_names_who_pressed(tmp_path: Path) -> None:
    """The robot brakes with the first line of the request; the name follows when it comes."""
    async with serving(tmp_path) as robot, robot.telemetry("state") as states:
        reader, writer = await asyncio.open_connection("127.0.0.1", robot.port)
        head = (
            "POST /stop HTTP/1.1",
            "Host: 127.0.0.1",
            f"Authorization: Bearer {robot.token}",
            "Content-Length: 13",
            "\r\n",
        )
        writer.write("\r\n".join(head).encode())
        stopped = await states.state(lambda state: state.stop is not None)
        assert stopped.stop is not None
        writer.write(b'{"by": "Ana"}')
        answer = await reader.readuntil(b"}}")
        assert answer.startswith(b"HTTP/1.1 200")
        if b'"by":"Ana"' in answer:  # else the machine stood still for longer than a body may take
            await states.state(lambda state: state.stop is not None and state.stop.by == "Ana")
        writer.close()


async def test_a_stop_and_its_name_do_not_wait_for_a_body_that_never_comes(tmp_path: Path) -> None:
    """A motion ends with the name of who stopped it, so the name must come with the request."""
    async with serving(tmp_path, time_scale=1.0) as robot, robot.mcp() as client, robot.telemetry("state") as states:
        driving = asyncio.create_task(client.call_tool("navigate_to_place", {"place": "lab 2.3.7"}))
        await states.state(lambda state: state.twist.linear > 0.2)
        _reader, writer = await asyncio.open_connection("127.0.0.1", robot.port)
        head = (
            "POST /stop?by=Jos%C3%A9 HTTP/1.1",
            "Host: 127.0.0.1",
            f"Authorization: Bearer {robot.token}",
            "Content-Length: 99",
            "\r\n",
        )
        writer.write("\r\n".join(head).encode())
        stopped = await states.state(lambda state: state.stop is not None)
        assert stopped.stop is not None
        assert stopped.stop.by == "José"
        result = await driving
        assert result.content[0].text.startswith("stopped: Stopped by José.")  # type: ignore[union-attr]
        writer.close()


async def test_a_stop_that_cannot_be_released_for_good_stays(tmp_path: Path) -> None:
    async with serving(tmp_path) as robot, robot.http() as http:
        await http.post("/stop", params={"by": "Ana"})
        (tmp_path / FILE).unlink()
        (tmp_path / FILE).mkdir()  # cannot be unlinked, whoever runs this
        answer = await http.post("/release", params={"by": "Sue"})
        assert answer.status_code == 500
        assert answer.json()["error"].startswith("The stop cannot be released")
        async with robot.mcp() as client:
            assert "Stopped by Ana" in await refused(client, "rotate_in_place", degrees=10)


async def test_a_stop_ends_speech(tmp_path: Path) -> None:
    async with (
        serving(tmp_path, time_scale=1.0) as robot,
        robot.mcp() as client,
        robot.http() as http,
        robot.telemetry("state") as reader,
    ):
        speaking = asyncio.create_task(client.call_tool("speak", {"text": "A long story. " * 20}))
        await reader.state(lambda s: s.speaking is not None)
        await http.post("/stop", params={"by": "Ana"})
        result = await speaking
        assert result.is_error
        await reader.state(lambda s: s.stop is not None and s.speaking is None)
