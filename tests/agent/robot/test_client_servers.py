"""MCP servers that a client brings into its session: used where the rules say so, refused in words where not.

The robot, the agent and the server are processes of their own, and share no code with each other.
"""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from backend.agent.robot.client_servers import ClientServers
from backend.agent.robot.mcp_client import McpClient, Tool
from backend.agent.robot.server_addresses import Offer
from backend.agent.sessions.journal import Journal
from backend.agent.sessions.sessions import Sessions
from backend.agent.sessions.store import Store
from backend.chat.link import RefusedError
from backend.identity import Role
from tests.processes import PATIENCE_S, Client, Robot, end, eventually, free_port, listens, wait_until

HERE = Path(__file__).parents[1]
SECRET = "k-4711-do-not-show"
STDIO = {"name": "x", "command": "/bin/sh", "args": [], "env": []}


@dataclass
class Lab:
    """The server that is offered."""

    log: Path
    port: int = field(default_factory=free_port)
    process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        command = [sys.executable, str(HERE / "lab_server.py"), str(self.port), str(self.log)]
        self.process = subprocess.Popen(command, text=True)
        wait_until(lambda: listens(self.port), "the lab's server to answer")

    def stop(self) -> None:
        if self.process:
            end(self.process)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}/mcp"

    def offer(self, **changes: Any) -> dict[str, Any]:
        headers = [{"name": "X-Key", "value": SECRET}]
        return {"type": "http", "name": "lab", "url": self.url, "headers": headers} | changes

    @property
    def requests(self) -> list[tuple[str | None, str]]:
        """The key and the body of every request that arrived."""
        return [tuple(json.loads(line)) for line in self.log.read_text().splitlines()] if self.log.exists() else []

    @property
    def ran(self) -> list[str]:
        """The tools that were called."""
        bodies = [json.loads(body) for _, body in self.requests if '"tools/call"' in body]
        return [body["params"]["name"] for body in bodies]


@pytest.fixture(scope="module")
def offered(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    """The one lab that is on the list."""
    lab = Lab(tmp_path_factory.mktemp("lab") / "requests.jsonl")
    yield lab
    lab.stop()


@pytest.fixture
def lab(offered: Lab) -> Lab:
    """The lab at work, with nothing asked of it yet."""
    if offered.process is None or offered.process.poll() is not None:
        offered.start()
    offered.log.write_text("")
    return offered


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory, offered: Lab) -> Iterator[Robot]:
    """The agent of a robot that can do little, with the lab on its list; all that it logs is in `agent.log`."""
    variables = {
        "ROBOT_ACP_AGENT__ROBOT_URL": f"stdio:{sys.executable} {HERE / 'quiet_robot.py'}",
        "ROBOT_ACP_AGENT__MCP_ALLOW": json.dumps([offered.url]),
        "ROBOT_ACP_LOG_LEVEL": "debug",
    }
    robot = Robot(tmp_path_factory.mktemp("data"), variables)
    with (robot.data / "agent.log").open("w") as log:
        process = robot.spawn("agent", stderr=log)
        try:
            wait_until(lambda: listens(robot.agent_port), "the agent to answer")
            yield robot
        finally:
            end(process)


@pytest.fixture
async def client(robot: Robot) -> AsyncIterator[Client]:
    """A supervisor: on this machine everybody is one."""
    client = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
    yield client
    await client.close()


async def begin(client: Client, *servers: dict[str, Any], mode: str = "supervised") -> str:
    answer = await client.link.request("session/new", {"cwd": "/", "mcpServers": list(servers)})
    client.session = answer["sessionId"]
    if mode != "supervised":
        await client.link.request("session/set_mode", {"sessionId": client.session, "modeId": mode})
    return client.session


async def reopen(client: Client, method: str, *servers: dict[str, Any]) -> None:
    params = {"sessionId": client.session, "cwd": "/", "mcpServers": list(servers)}
    answer = await client.link.request(method, params)
    client.session = answer.get("sessionId", client.session)


def ends(client: Client) -> list[str]:
    """The last status of each tool call."""
    last = {u["toolCallId"]: u["status"] for u in client.of("tool_call_update") if "status" in u}
    return list(last.values())


def told(client: Client) -> int:
    return client.said.count("The MCP server lab does not answer, so its tools are missing.")


async def test_the_supervisors_server_is_used_and_what_it_says_to_read_runs_unasked(lab: Lab, client: Client) -> None:
    await begin(client, lab.offer())
    assert await client.prompt("take a photo") == "end_turn"
    (call,) = client.of("tool_call")
    assert (call["title"], call["kind"]) == ("lab: Take photo", "fetch")
    assert call["_meta"]["robot-acp/tool"] == "lab__take_photo"
    assert client.questions == []
    assert ends(client) == ["completed"]
    assert lab.ran == ["take_photo"]
    assert "Here is what I see." in client.said
    assert told(client) == 0


@pytest.mark.parametrize(("answer", "status", "ran"), [("allow_once", "completed", 1), ("reject_once", "failed", 0)])
async def test_what_says_nothing_of_itself_asks_first(
    lab: Lab, client: Client, answer: str, status: str, ran: int
) -> None:
    client.answer = answer
    await begin(client, lab.offer())
    await client.prompt("how is the battery?")
    (question,) = client.questions
    assert question["params"]["toolCall"]["title"] == "lab: Get robot status"
    assert question["params"]["toolCall"]["kind"] == "other"
    assert ends(client) == [status]
    assert lab.ran == ["get_robot_status"] * ran


@pytest.mark.parametrize(
    ("mode", "prompt", "questions", "ran"),
    [
        ("movement", "say hello", 1, ["speak"]),  # the robot's own is denied
        ("autonomous", "say hello", 1, ["speak"]),  # the robot's own is allowed
        ("supervised", "turn left by 20 degrees", 1, ["rotate_in_place"]),  # allowed
        ("plan", "turn left by 20 degrees", 0, []),  # previewed
        ("observe", "say hello", 0, []),
        ("observe", "take a photo", 0, ["take_photo"]),
    ],
)
async def test_a_tool_with_the_name_of_the_robots_is_judged_as_a_strangers(
    lab: Lab, client: Client, mode: str, prompt: str, questions: int, ran: list[str]
) -> None:
    await begin(client, lab.offer(), mode=mode)
    await client.prompt(prompt)
    assert len(client.questions) == questions
    assert lab.ran == ran
    assert '"plan_only": true' not in lab.log.read_text().replace('\\"', '"')


async def test_people_who_are_asked_see_the_arguments_and_not_what_the_server_makes_of_them(
    lab: Lab, client: Client
) -> None:
    await begin(client, lab.offer())
    await client.prompt("say hello")
    assert client.questions[0]["params"]["toolCall"]["title"] == "lab: Speak: text Hello."


async def test_a_command_is_the_robots_own_business(lab: Lab, client: Client) -> None:
    await begin(client, lab.offer())
    await client.prompt("/photo")
    assert client.of("tool_call") == []
    assert lab.requests == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"url": "http://127.0.0.1:1/mcp"}, r"not on the list of this robot.*agent\.mcp_allow"),
        ({"url": "{url}evil"}, "not on the list of this robot"),
        ({"url": "{url}/../admin"}, "address of the MCP server lab cannot be used"),
        ({"url": "{url}/%2e%2e/admin"}, "address of the MCP server lab cannot be used"),
        ({"url": "{url}?key=1"}, "address of the MCP server lab cannot be used"),
        ({"name": "the lab"}, "name of an MCP server begins the names of its tools"),
        ({"headers": [{"name": "Host", "value": SECRET}]}, "belongs to the connection itself"),
        ({"type": "sse"}, "no MCP servers of the type sse"),
    ],
)
@pytest.mark.parametrize("method", ["session/new", "session/load", "session/resume", "session/fork"])
async def test_what_is_refused_is_refused_in_words_and_nothing_is_connected(
    lab: Lab, client: Client, method: str, change: dict[str, Any], said: str
) -> None:
    await begin(client)
    before = (await client.link.request("session/list", {}))["sessions"]
    server = lab.offer(**change)
    server["url"] = server["url"].replace("{url}", lab.url)
    with pytest.raises(RefusedError, match=said) as refused:
        await reopen(client, method, lab.offer(name="good"), server)
    assert SECRET not in str(refused.value)
    assert (await client.link.request("session/list", {}))["sessions"] == before
    await client.prompt("take a photo")
    assert lab.requests == []


async def test_stdio_servers_are_refused_because_they_are_commands(lab: Lab, client: Client) -> None:
    with pytest.raises(RefusedError, match=r"stdio MCP servers: they are commands on the robot's computer\. Offer"):
        await begin(client, lab.offer(), STDIO)
    assert lab.requests == []


@pytest.mark.parametrize(
    ("role", "said"),
    [
        (Role.OPERATOR, "Only a supervisor may bring MCP servers into a session; your role is operator"),
        (Role.VISITOR, "Only a supervisor may bring MCP servers into a session; your role is visitor"),
        (Role.VIEWER, "The role viewer may not prompt"),
    ],
)
async def test_nobody_but_a_supervisor_may_offer(robot: Robot, lab: Lab, client: Client, role: Role, said: str) -> None:
    await client.link.request(
        "authenticate", {"methodId": "token", "_meta": {"robot-acp/token": robot.token("Ana", role)}}
    )
    with pytest.raises(RefusedError, match=said):
        await begin(client, lab.offer())
    assert lab.requests == []


async def test_the_capabilities_say_whether_servers_are_taken(robot: Robot, tmp_path: Path) -> None:
    for variables, taken in ((robot.environment, True), ({}, False)):
        other = Robot(tmp_path / "other", variables)
        with other.running("agent", port=other.agent_port):
            client = await Client.open(f"tcp://127.0.0.1:{other.agent_port}")
            hello = await client.link.request("initialize", {"protocolVersion": 1, "clientCapabilities": {}})
            assert hello["agentCapabilities"]["mcpCapabilities"] == {"http": taken, "sse": False}
            await client.close()


async def test_a_list_with_no_address_in_it_is_named_at_the_start(tmp_path: Path) -> None:
    robot = Robot(tmp_path, {"ROBOT_ACP_AGENT__MCP_ALLOW": '["https://x.org", "https://user@x.org"]'})
    process = robot.spawn("agent", stderr=subprocess.PIPE)
    _, said = await asyncio.to_thread(process.communicate, timeout=60)
    assert process.returncode != 0
    assert "agent.mcp_allow: entry 2 cannot be used" in said


async def test_a_server_that_is_away_is_told_once_and_found_again(lab: Lab, client: Client) -> None:
    lab.stop()
    await begin(client, lab.offer())
    assert await client.prompt("where are you?") == "end_turn"
    assert "I am at x 1.0 m, y 2.0 m." in client.said
    assert told(client) == 1
    await client.prompt("take a photo")
    assert "I have no tool for this: Take a photo." in client.said
    assert told(client) == 1
    lab.start()
    await client.prompt("take a photo")
    assert lab.ran == ["take_photo"]
    assert told(client) == 1


async def test_a_server_that_dies_fails_its_call_and_ends_no_turn(lab: Lab, client: Client) -> None:
    await begin(client, lab.offer())
    await client.prompt("take a photo")
    lab.stop()
    assert await client.prompt("take a photo, then tell me where you are") == "end_turn"
    assert ends(client) == ["completed", "failed", "completed"]
    assert "The MCP server lab does not answer." in json.dumps(client.of("tool_call_update"))
    assert told(client) == 0  # its tools were there
    await client.prompt("where are you?")
    assert told(client) == 1
    lab.start()
    await client.prompt("take a photo")
    assert ends(client)[-1] == "completed"
    lab.stop()
    await client.prompt("take a photo")
    await client.prompt("where are you?")
    assert told(client) == 2  # it was lost anew


async def test_what_its_headers_hold_is_nowhere_but_at_the_server(robot: Robot, lab: Lab, client: Client) -> None:
    watcher = await Client.open(f"tcp://127.0.0.1:{robot.agent_port}")
    await begin(client, lab.offer())
    await client.prompt("take a photo")
    await client.prompt("how is the battery?")
    lab.stop()
    await client.prompt("take a photo")
    await client.prompt("where are you?")
    with pytest.raises(RefusedError):
        await reopen(client, "session/load", lab.offer(url=f"http://{SECRET}@127.0.0.1/"))
    await watcher.load(client.session)
    assert watcher.of("tool_call")
    assert {key for key, _ in lab.requests} == {SECRET}
    assert SECRET not in json.dumps([client.heard, watcher.heard])
    files = {file.name: file.read_bytes() for file in robot.data.rglob("*") if file.is_file()}  # the log is one
    assert f"no MCP server at http://127.0.0.1:{lab.port}".encode() in files["agent.log"]
    assert any(b"lab__take_photo" in content for content in files.values())  # what was done is there
    assert [name for name, content in files.items() if SECRET.encode() in content] == []
    await watcher.close()


@pytest.mark.parametrize("method", ["session/load", "session/resume"])
async def test_opening_a_session_again_leaves_its_servers_or_replaces_them(
    lab: Lab, client: Client, method: str
) -> None:
    await begin(client, lab.offer())
    await reopen(client, method)
    await client.prompt("take a photo")
    assert lab.ran == ["take_photo"]
    await reopen(client, method, lab.offer(name="bench"))
    await client.prompt("take a photo")
    assert [c["_meta"]["robot-acp/tool"] for c in client.of("tool_call")][-1] == "bench__take_photo"


async def test_a_fork_has_the_servers_of_its_own_request_only(lab: Lab, client: Client) -> None:
    original = await begin(client, lab.offer())
    await reopen(client, "session/fork")
    await client.prompt("take a photo")
    assert lab.requests == []
    client.session = original
    await reopen(client, "session/fork", lab.offer())
    await client.prompt("take a photo")
    assert lab.ran == ["take_photo"]


async def test_a_session_that_was_closed_has_let_its_servers_go(lab: Lab, client: Client) -> None:
    await begin(client, lab.offer())
    await client.prompt("take a photo")
    await client.link.request("session/close", {"sessionId": client.session})
    await client.prompt("take a photo")
    assert lab.ran == ["take_photo"]
    assert "I have no tool for this: Take a photo." in client.said


def connections() -> list[asyncio.Task[Any]]:
    return [task for task in asyncio.all_tasks() if task.get_name() == "mcp connection"]


async def test_connections_end_with_what_they_belong_to(lab: Lab) -> None:
    offer = Offer("lab", lab.url, {})
    servers = ClientServers()
    await servers.take([offer])
    assert connections() == []  # not before a turn wants them
    await servers.beside({})
    assert len(connections()) == 1
    await servers.take([offer])
    assert connections() == []
    await servers.beside({})
    await servers.close()
    assert connections() == []
    result = await servers.call("lab__take_photo", {})  # a turn that still runs must not bring it back
    assert result.failed
    assert connections() == []


async def test_a_call_ends_with_the_connection_that_it_runs_on(lab: Lab) -> None:
    servers = ClientServers()
    await servers.take([Offer("lab", lab.url, {})])
    await servers.beside({})
    call = asyncio.create_task(servers.call("lab__grow_crystals", {}))
    await eventually(lambda: lab.ran == ["grow_crystals"], "the call to arrive")
    await servers.close()
    async with asyncio.timeout(PATIENCE_S):
        result = await call
    assert result.failed
    assert result.text == "The MCP server lab does not answer."


async def test_a_session_that_nobody_uses_lets_its_servers_go(lab: Lab, tmp_path: Path) -> None:
    store = Store(f"sqlite:///{tmp_path / 'sessions.db'}")
    await store.open()
    nowhere = McpClient(f"http://127.0.0.1:{free_port()}/mcp", absent="There is no robot.")
    kept = Sessions(store, Journal(store), nowhere, "get_current_pose", 1.0)
    session = await kept.create("Ana", "/", "supervised", "offline/commands")
    await session.client_servers.take([Offer("lab", lab.url, {})])
    await session.client_servers.beside({})
    await kept.create("Ana", "/", "supervised", "offline/commands")
    assert len(connections()) == 1
    kept.idle_s = -1.0
    await kept.create("Ana", "/", "supervised", "offline/commands")
    await eventually(lambda: connections() == [], "the connection to end")
    await kept.close()
    await store.close()


async def test_no_tool_of_the_robot_is_shadowed_and_every_name_is_one_for_a_model(lab: Lab) -> None:
    own = Tool("lab__take_photo", "The robot's own.", {}, "Take a photo", None, True)
    servers = ClientServers()
    await servers.take([Offer("lab", lab.url, {})])
    tools = await servers.beside({own.name: own})
    assert tools[own.name] is own
    assert list(tools) == [
        "lab__take_photo",
        "lab__get_robot_status",
        "lab__speak",
        "lab__rotate_in_place",
        "lab__stock_list_all",
        "lab__grow_crystals",
    ]
    assert (await servers.call("lab__stock_list_all", {})).text == "screws"
    assert not any(tool.traits.can_preview for tool in tools.values())
    await servers.close()
