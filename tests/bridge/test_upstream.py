"""The agent's side: TCP and stdio, not there, gone in the middle, slow, and talking nonsense."""

from __future__ import annotations

import asyncio
import os
import shlex
import sys
from pathlib import Path

import orjson
import pytest

from backend.bridge.limits import Limits
from backend.bridge.upstream import agent_at
from backend.config import ConfigError
from tests.bridge.scenes import PATIENCE

STDIO_AGENT = shlex.join([sys.executable, str(Path(__file__).with_name("stdio_agent.py"))])
PING = b'{"jsonrpc":"2.0","method":"$/ping"}'


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


async def test_while_the_agent_is_down_a_client_is_let_in_and_told_so(bridge_with, closing):
    async with bridge_with() as bridge, bridge.websocket() as websocket:
        assert await closing(websocket) == (1013, "The agent is not running.")


async def test_an_agent_that_dies_in_the_middle_ends_the_connection_with_a_reason(client, agent, closing):
    agent.hang_up()
    assert await closing(client) == (1012, "The agent has stopped.")


async def test_what_the_agent_said_last_arrives_before_the_end(client, agent, closing):
    await agent.say(PING + b"\n" + PING + b"\n")
    agent.hang_up()
    assert [(await client.recv()).encode() for _ in range(2)] == [PING, PING]
    assert (await closing(client))[0] == 1012


async def test_when_the_client_leaves_its_agent_connection_ends(bridge, agent, initialize):
    async with bridge.websocket() as websocket:
        await websocket.send(initialize.decode())
        await agent.heard()
    async with asyncio.timeout(PATIENCE):
        await agent.left.wait()


async def test_lines_of_the_agent_that_are_no_messages_are_dropped_with_a_warning(client, agent, caplog):
    await agent.say(b"Listening on port 9100\n\n   \n[1,2]\n" + PING + b"\n")
    assert (await client.recv()).encode() == PING
    warnings = [record for record in caplog.records if "dropped a line of the agent" in record.message]
    assert len(warnings) == 2  # blank lines are nothing to warn of


async def test_a_line_that_comes_in_pieces_is_put_together(client, agent):
    for byte in PING + b"\n":
        await agent.say(bytes([byte]))
    assert (await client.recv()).encode() == PING


async def test_an_agent_on_stdio_is_a_process_of_its_own_for_each_client(bridge_with, initialize, wait_until):
    async with bridge_with(bridge={"agent": f"stdio:{STDIO_AGENT}"}) as bridge:
        async with bridge.websocket() as one, bridge.websocket() as other:
            pids = []
            for websocket in (one, other):
                await websocket.send(initialize.decode())
                result = orjson.loads(await websocket.recv())["result"]
                assert result["heard"]["params"]["_meta"].keys() == {"robot-acp/token"}
                pids.append(result["pid"])
            assert len(set(pids)) == 2
            assert all(alive(pid) for pid in pids)
        await wait_until(lambda: not any(alive(pid) for pid in pids))


async def test_a_child_that_ends_by_itself_ends_the_connection(bridge_with, initialize, closing):
    async with bridge_with(bridge={"agent": f"stdio:{STDIO_AGENT}"}) as bridge, bridge.websocket() as websocket:
        await websocket.send(initialize.decode())
        await websocket.recv()
        await websocket.send('{"jsonrpc":"2.0","method":"_exit"}')
        assert await closing(websocket) == (1012, "The agent has stopped.")


async def test_a_child_that_does_not_exit_is_killed(bridge_with, initialize, wait_until):
    stubborn = {"agent": f"stdio:{STDIO_AGENT} --stubborn"}
    async with bridge_with(bridge=stubborn, limits=Limits(agent_exit_seconds=1.0)) as bridge:
        async with bridge.websocket() as websocket:
            await websocket.send(initialize.decode())
            pid = orjson.loads(await websocket.recv())["result"]["pid"]
        assert alive(pid)
        await wait_until(lambda: not alive(pid))


async def test_the_bridges_end_is_the_childs_end(bridge_with, initialize, wait_until):
    async with bridge_with(bridge={"agent": f"stdio:{STDIO_AGENT}"}) as bridge:
        websocket = await bridge.websocket()
        await websocket.send(initialize.decode())
        pid = orjson.loads(await websocket.recv())["result"]["pid"]
    await wait_until(lambda: not alive(pid))
    await websocket.close()


async def test_a_command_that_does_not_exist_is_told_to_the_client(bridge_with, closing):
    async with bridge_with(bridge={"agent": "stdio:/no/such/agent"}) as bridge, bridge.websocket() as websocket:
        assert await closing(websocket) == (1013, "The agent cannot be started.")


@pytest.mark.parametrize(
    "address",
    ["", "stdio:", "stdio:'", "9100", "tcp://", "tcp://host", "tcp://host:port", "http://host:1", "host:9100"],
)
def test_an_address_that_is_none_is_a_setting_error_that_names_it(address):
    with pytest.raises(ConfigError, match=r"bridge\.agent"):
        agent_at(address, Limits())


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9100", "tcp://[::1]:9100", "stdio:agent --stdio"])
def test_addresses_that_are_understood(address):
    assert agent_at(address, Limits())
