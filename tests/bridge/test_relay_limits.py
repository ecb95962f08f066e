"""What a connection may not do: be too big, too many, too slow, too late, or outlive its login."""

from __future__ import annotations

import asyncio
import contextlib
import socket

import orjson
from websockets.exceptions import ConnectionClosed

from backend import wire
from backend.bridge.limits import Limits
from tests.bridge.scenes import PATIENCE

PING = '{"jsonrpc":"2.0","method":"$/ping"}'


def message_of(size: int) -> str:
    head, tail = '{"jsonrpc":"2.0","method":"x","params":{"a":"', '"}}'
    return head + "a" * (size - len(head) - len(tail)) + tail


async def test_a_message_of_the_largest_size_passes_and_a_larger_one_ends_the_connection(
    bridge_with, agent, initialize, closing
):
    async with (
        bridge_with(agent={"port": agent.port}, bridge={"max_frame_bytes": 4096}) as bridge,
        bridge.websocket() as websocket,
    ):
        await websocket.send(initialize.decode())
        await agent.heard()
        await websocket.send(message_of(4095) + "\n")
        assert len(await agent.heard()) == 4096
        await websocket.send(message_of(4097))
        assert (await closing(websocket))[0] == 1009


async def test_a_line_of_the_agent_that_is_too_long_is_dropped_and_the_next_one_passes(
    bridge_with, agent, initialize, caplog
):
    async with (
        bridge_with(agent={"port": agent.port}, bridge={"max_frame_bytes": 4096}) as bridge,
        bridge.websocket() as websocket,
    ):
        await websocket.send(initialize.decode())
        await agent.heard()
        await agent.say(message_of(3_000_000).encode() + b"\n" + PING.encode() + b"\n")
        assert await websocket.recv() == PING
    assert "larger than 4096 bytes" in caplog.text


async def test_who_waits_for_a_message_of_the_agent_that_is_too_large_gets_an_error(bridge_with, agent, initialize):
    async with (
        bridge_with(agent={"port": agent.port}, bridge={"max_frame_bytes": 4096}) as bridge,
        bridge.websocket() as websocket,
    ):
        await websocket.send(initialize.decode())
        await agent.heard()
        large = "x" * 3_000_000
        await agent.say(
            b'{"jsonrpc":"2.0","id":"a\\"7","result":{"all":"' + large.encode() + b'"}}\n' + PING.encode() + b"\n"
        )
        answer = orjson.loads(await websocket.recv())
        assert (answer["id"], answer["error"]["code"]) == ('a"7', wire.INTERNAL_ERROR)
        assert "larger than the 4096 bytes" in answer["error"]["message"]
        assert await websocket.recv() == PING
        await agent.say(b'{"jsonrpc":"2.0","id":"p1","method":"ask","params":{"all":"' + large.encode() + b'"}}\n')
        told = orjson.loads(await agent.heard())
        assert (told["id"], told["error"]["code"]) == ("p1", wire.INTERNAL_ERROR)


async def test_a_message_nested_too_deep_is_answered(client, agent):
    await client.send('{"jsonrpc":"2.0","id":1,"method":"x","params":' + '{"a":' * 99 + "1" + "}" * 100)
    assert orjson.loads(await client.recv())["error"]["code"] == wire.INVALID_REQUEST


async def test_a_login_that_expires_ends_the_connection(bridge, agent, initialize, closing):
    async with bridge.websocket(token=bridge.token(lifetime_s=4)) as websocket:
        await websocket.send(initialize.decode())
        await agent.heard()
        assert await closing(websocket) == (4401, "Your login has expired. Log in again.")


async def test_a_client_that_never_begins_is_disconnected(bridge_with, agent, closing):
    quick = Limits(first_frame_seconds=0.1)
    async with bridge_with(agent={"port": agent.port}, limits=quick) as bridge, bridge.websocket() as websocket:
        assert await closing(websocket) == (1008, "The client did not begin with initialize.")


async def raw_client(bridge, initialize: bytes) -> socket.socket:
    """A WebSocket on a bare socket with a small buffer, so that a test decides when it reads."""
    bare = socket.socket()
    bare.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 16 * 1024)
    bare.setblocking(False)
    loop = asyncio.get_running_loop()
    await loop.sock_connect(bare, ("127.0.0.1", bridge.port))
    await loop.sock_sendall(
        bare,
        f"GET /acp HTTP/1.1\r\nHost: 127.0.0.1:{bridge.port}\r\nAuthorization: Bearer {bridge.token()}\r\n"
        "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode(),
    )
    answer = await loop.sock_recv(bare, 4096)
    assert b" 101 " in answer
    await loop.sock_sendall(bare, b"\x81" + bytes([0x80 | len(initialize)]) + b"\0\0\0\0" + initialize)
    return bare


async def test_an_agent_waits_for_a_client_that_reads_slowly_and_nothing_is_lost(bridge, agent, initialize):
    with contextlib.closing(await raw_client(bridge, initialize)) as bare:
        await agent.heard()
        update = b'{"jsonrpc":"2.0","method":"u","params":{"a":"' + b"x" * 60_000 + b'"}}\n'
        count = 500  # 30 MB: more than all buffers on the way hold
        flooding = asyncio.create_task(agent.say(update * count))
        received = 0
        loop = asyncio.get_running_loop()
        async with asyncio.timeout(PATIENCE):
            while received < count * len(update):
                received += len(await loop.sock_recv(bare, 1 << 20))
        await flooding


async def test_a_client_that_does_not_read_is_cut_off_and_little_was_kept_for_it(bridge_with, agent, initialize):
    async with bridge_with(agent={"port": agent.port}, limits=Limits(stall_seconds=0.3)) as bridge:
        with contextlib.closing(await raw_client(bridge, initialize)):
            await agent.heard()
            update = b'{"jsonrpc":"2.0","method":"u","params":{"a":"' + b"x" * 60_000 + b'"}}\n'
            taken = 0
            with contextlib.suppress(ConnectionError):
                async with asyncio.timeout(PATIENCE):
                    while not agent.left.is_set():
                        await agent.say(update)
                        taken += len(update)
        assert taken < 40_000_000  # what the kernel's buffers hold, not what was sent


async def test_a_client_that_reads_slowly_but_reads_is_not_cut_off(bridge_with, agent, initialize):
    stall_seconds, rate = 1.0, 3_500_000  # bytes a second that the client reads
    async with bridge_with(agent={"port": agent.port}, limits=Limits(stall_seconds=stall_seconds)) as bridge:
        with contextlib.closing(await raw_client(bridge, initialize)) as bare:
            await agent.heard()
            frame = message_of(12_000_000).encode()
            sending = asyncio.create_task(agent.say(frame + b"\n"))
            loop = asyncio.get_running_loop()
            started, received = loop.time(), 0
            async with asyncio.timeout(PATIENCE):
                while received < len(frame):
                    received += len(await loop.sock_recv(bare, 400_000))
                    due = started + received / rate
                    await asyncio.sleep(max(0, due - loop.time()))  # not a wait for anything: this is the slowness
            assert loop.time() - started > 3 * stall_seconds
            await sending
            assert not agent.left.is_set()


async def test_a_client_waits_for_an_agent_that_does_not_read_and_is_told_in_the_end(bridge_with, agent, initialize):
    frame = message_of(1_000_000)
    sent = 0
    async with (
        bridge_with(agent={"port": agent.port}, limits=Limits(stall_seconds=0.5)) as bridge,
        bridge.websocket() as client,
        asyncio.timeout(PATIENCE),
    ):
        await client.send(initialize.decode())
        await agent.heard()
        agent.reading.clear()
        with contextlib.suppress(ConnectionClosed):
            while True:
                await client.send(frame)
                sent += len(frame)
    assert (client.close_code, client.close_reason) == (1013, "The agent does not respond.")
    assert sent < 120_000_000
