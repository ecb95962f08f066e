"""What is too large to be kept is refused in words, and the next request is answered. A stop is never refused."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from acp.router import MessageRouter

from backend import wire
from backend.agent.acp import content_limits, updates
from backend.agent.acp.dispatch import Dispatcher
from backend.agent.acp.request_limits import RequestLimits
from backend.agent.robot.mcp_client import ToolResult
from backend.agent.sessions.session import MAX_EVENT_BYTES
from backend.agent.sessions.store import Store
from backend.chat.link import RefusedError
from backend.config import Storage
from backend.identity import Role
from tests.agent.conftest import Opener
from tests.agent.sessions.test_journal import at_work
from tests.databases import Database
from tests.processes import PATIENCE_S, Robot

TEXT = {"type": "text", "text": ""}
LIMITS = Storage()


def picture(size: int) -> dict[str, str]:
    return {"type": "image", "mimeType": "image/png", "data": "A" * size}


@pytest.mark.parametrize(
    ("prompt", "told"),
    [
        ([TEXT] * 100_000, "100000 content blocks, and at most 100 are taken"),
        ([{"type": "text", "text": "x" * 60_000}] * 2, "120000 characters, and at most 100000"),
        ([picture(5_000_000)] * 3, "15000000 bytes, and at most 12582912"),
        ([TEXT | {"_meta": {"a": "x" * 70_000}}], "names, addresses and _meta"),
        (
            [{"type": "resource", "resource": {"uri": "file:///x", "text": "x" * 200_000}}],
            "200000 characters, and at most 100000",
        ),
        ([{"type": "resource_link", "name": "x" * 70_000, "uri": "x:y"}], "names, addresses and _meta"),
    ],
)
async def test_a_prompt_that_is_too_large_is_refused_and_the_next_one_is_not(
    connect: Opener, prompt: list[dict[str, Any]], told: str
) -> None:
    client = await connect()
    await client.new()
    with pytest.raises(RefusedError, match=told):
        await client.link.request("session/prompt", {"sessionId": client.session, "prompt": prompt})
    assert await client.prompt("where are you?") == "end_turn"


async def test_the_largest_prompt_is_taken(connect: Opener) -> None:
    client, other = await connect(), await connect()
    await client.new()
    await other.load(client.session)
    prompt = [{"type": "text", "text": "where are you?"}, picture(LIMITS.max_prompt_bytes), *[TEXT] * 98]
    answer = await client.link.request("session/prompt", {"sessionId": client.session, "prompt": prompt})
    assert answer["stopReason"] == "end_turn"
    assert len(other.of("user_message_chunk")) == 100


async def test_a_stop_is_never_too_large(robot: Robot, connect: Opener) -> None:
    client = await connect()
    await client.new()
    spaced = {"type": "text", "text": "/stop" + " " * 1_000_000}
    await client.link.request("session/prompt", {"sessionId": client.session, "prompt": [spaced]})
    assert (await robot.state()).stop is not None
    await client.link.request("_robot/release", {})
    late = await connect()
    await late.load(client.session)
    assert late.of("user_message_chunk")[0]["content"] == {"type": "text", "text": "/stop"}


@pytest.mark.parametrize(
    ("method", "params"),
    [
        ("session/new", {"cwd": "/" + "x" * 9_000_000, "mcpServers": []}),
        ("session/new", {"cwd": "/", "mcpServers": [{}] * 10_000}),
        ("session/load", {"cwd": "/" + "x" * 5000, "mcpServers": [], "sessionId": "s"}),
        ("session/resume", {"cwd": "/" + "x" * 5000, "mcpServers": [], "sessionId": "s"}),
        ("session/fork", {"cwd": "/" + "x" * 5000, "mcpServers": [], "sessionId": "s"}),
        ("session/list", {"cursor": "x" * 1_000_000}),
        ("session/list", {"_meta": {"robot-acp/search": "x " * 500_000}}),
        ("session/set_mode", {"sessionId": "s", "modeId": "x" * 1_000_000}),
        ("session/set_model", {"sessionId": "s", "modelId": "x" * 1_000_000}),
        ("session/set_config_option", {"sessionId": "s", "configId": "mode", "value": "x" * 1_000_000}),
    ],
)
async def test_a_text_that_is_too_long_is_refused(connect: Opener, method: str, params: dict[str, Any]) -> None:
    client = await connect()
    with pytest.raises(RefusedError, match="at most"):
        await client.link.request(method, params)


def test_every_method_that_takes_a_folder_is_limited() -> None:
    for name in ("cwd", "cursor", "modeId", "modelId", "configId", "value"):
        with pytest.raises(Exception, match=f"{name} has 1000000 characters"):
            content_limits.check("session/whatever", {name: "x" * 1_000_000}, LIMITS)


async def test_two_sessions_of_an_older_version_with_huge_folders_can_be_listed(robot: Robot, connect: Opener) -> None:
    """Their folders were kept before there was a limit; everybody's list must come back, across restarts."""
    old = robot.with_another_agent()
    store = Store(f"sqlite:///{robot.data / f'sessions-{old.agent_port}.db'}")
    await store.open()
    from tests.agent.sessions.stores import NOW, ROW, event

    for number in range(60):
        name = f"old{number:02}"
        await store.add_session(type(ROW)(**vars(ROW) | {"id": name, "cwd": "/" + "\x01" * 2_000_000}))
        await store.append([event(1, session=name, time=NOW + number)])
    await store.close()
    with old.running("agent", port=old.agent_port):
        client = await connect_to(old)
        seen: list[str] = []
        cursor: str | None = None
        pages = 0
        while pages == 0 or cursor:
            page = await client.link.request("session/list", {"cursor": cursor} if cursor else {})
            seen += [one["sessionId"] for one in page["sessions"]]
            cursor, pages = page.get("nextCursor"), pages + 1
        assert sorted(seen) == [f"old{number:02}" for number in range(60)]
        assert pages > 2, "a page ends by its bytes, too"
        await client.close()


async def connect_to(robot: Robot) -> Any:
    from tests.processes import Client

    return await Client.open(f"tcp://127.0.0.1:{robot.agent_port}", robot.token("Olga", Role.SUPERVISOR))


async def test_an_answer_that_fits_into_no_message_is_an_error() -> None:
    sent: list[bytes] = []
    router = MessageRouter()

    async def everything(_name: str, _params: dict[str, Any]) -> dict[str, str]:
        return {"all": "x" * wire.MAX_FRAME_BYTES}

    router.handle_extension_request(everything)
    async with asyncio.timeout(PATIENCE_S), asyncio.TaskGroup() as handlers:
        dispatcher = Dispatcher(router, sent.append, handlers, RequestLimits().new)
        await dispatcher.begin(wire.check(b'{"jsonrpc":"2.0","id":7,"method":"_x/all","params":{}}'))
    [reply] = sent
    frame = wire.check(reply)
    assert frame.id == 7
    assert "Ask for less of it" in frame.body["error"]["message"]


async def test_an_event_that_fits_into_no_message_is_kept_without_what_it_contains(database: Database) -> None:
    async with at_work(database) as work:
        huge = "x" * MAX_EVENT_BYTES
        work.session.record(updates.tool_result("t.1", ToolResult(False, [updates.text_block(huge)], {"all": huge})))
        work.session.record(updates.message(huge))
        work.tell("next")
        await work.session.flushed()
        events = [event async for event in work.store.events("s1")]
        assert [len(event.raw) < 1000 for event in events] == [True] * 3
        assert events[0].update["status"] == "completed"
        assert "more than a message may have" in events[0].update["content"][0]["content"]["text"]


async def test_a_quota_is_told_and_deleting_makes_room(robot: Robot) -> None:
    limits = {"ROBOT_ACP_AGENT__STORAGE__SUPERVISOR_BYTES": "60000", "ROBOT_ACP_AGENT__STORAGE__VISITOR_SESSIONS": "3"}
    own = robot.with_another_agent(limits)
    with own.running("agent", port=own.agent_port):
        client = await connect_to(own)
        first = await client.new()
        large = [{"type": "text", "text": "where are you?"}, {"type": "text", "text": "x" * 50_000}]
        await client.link.request("session/prompt", {"sessionId": first, "prompt": large})
        with pytest.raises(RefusedError, match=r"there is no room for this\. Delete sessions"):
            await client.link.request("session/prompt", {"sessionId": first, "prompt": large})
        with pytest.raises(RefusedError, match="there is no room for this"):
            await client.link.request("session/fork", {"sessionId": first, "cwd": "/", "mcpServers": []})
        second = await client.new()
        await client.link.request("session/delete", {"sessionId": first})
        client.session = second
        assert await client.prompt("where are you?") == "end_turn"
        token = {"robot-acp/token": own.token("Kiosk", Role.VISITOR)}
        await client.link.request("authenticate", {"methodId": "token", "_meta": token})
        visits = []
        for _ in range(6):
            visits.append(await client.new())
            assert await client.prompt("where are you?") == "end_turn"
            await client.link.request("_robot/leave", {"sessionId": client.session})
        listed = [one["sessionId"] for one in (await client.link.request("session/list", {}))["sessions"]]
        assert listed[0] == visits[-1]
        assert len(listed) <= 3
        await client.close()
