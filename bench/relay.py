"""What the bridge adds: a JSON-RPC round trip and one-way updates, direct over TCP and through the bridge.

    python bench/relay.py [--rounds 4000] [--updates 100000]

Three processes on loopback, as in use: an agent that echoes, the bridge, and this client. Direct and bridged
rounds take turns, so that a busy machine disturbs both alike. Reported are medians in milliseconds, twice:
with all three on one core, which is the bridge's own work (to be below 0.15 ms), and as the machine places
them, which adds what it costs there to wake a core. Then updates a second from the agent to the client.
"""

from __future__ import annotations

import argparse
import asyncio
import multiprocessing
import os
import statistics
import tempfile
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import orjson

from backend import config, tokens
from backend.bridge import server
from backend.identity import Role

INITIALIZE = b'{"jsonrpc":"2.0","id":0,"method":"initialize","params":{"protocolVersion":1}}'
REQUEST = b'{"jsonrpc":"2.0","id":%d,"method":"session/list","params":{}}'
UPDATE = orjson.dumps(
    {
        "jsonrpc": "2.0",
        "method": "session/update",
        "params": {
            "sessionId": "s1",
            "update": {
                "sessionUpdate": "agent_message_chunk",
                "content": {"type": "text", "text": "Driving there."},
            },
            "_meta": {"robot-acp/seq": 12345},
        },
    }
)
BLOCK = 200
"""Rounds in a row on one side before the other has its turn."""


class EchoAgent(asyncio.Protocol):
    """Answers every line with the line; `_flood` is answered with as many updates as it asks for."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport
        self.rest = b""

    def data_received(self, data: bytes) -> None:
        *lines, self.rest = (self.rest + data).split(b"\n")
        for line in lines:
            if b'"_flood"' in line:
                count = orjson.loads(line)["params"]["count"]
                self.transport.write((UPDATE + b"\n") * count)
            self.transport.write(line + b"\n")


def run_agent(address: multiprocessing.Queue) -> None:
    async def main() -> None:
        listening = await asyncio.get_running_loop().create_server(EchoAgent, "127.0.0.1", 0)
        address.put(listening.sockets[0].getsockname()[1])
        await listening.serve_forever()

    asyncio.run(main())


def run_bridge(flags: dict[str, object], address: multiprocessing.Queue) -> None:
    settings = config.load(**flags)
    listener = server.listen(settings)
    address.put(listener.getsockname()[1])
    asyncio.run(server.serve(settings, listener=listener))


async def timed(rounds: int, once: Callable[[int], Awaitable[None]]) -> list[float]:
    times = []
    for number in range(rounds):
        begin = time.perf_counter()
        await once(number)
        times.append(time.perf_counter() - begin)
    return times


class LeanSocket:
    """A WebSocket client with next to no cost of its own, so that the difference is the bridge's.

    It speaks to a server that it knows: text frames below 64 KiB, no fragments, a mask of zeros.
    """

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._writer = writer

    @classmethod
    async def connect(cls, port: int, token: str) -> LeanSocket:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(
            f"GET /acp HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nAuthorization: Bearer {token}\r\n"
            "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
        )
        answer = await reader.readuntil(b"\r\n\r\n")
        assert b" 101 " in answer, answer
        return cls(reader, writer)

    def send(self, text: bytes) -> None:
        size = len(text)
        length = bytes([0x80 | size]) if size < 126 else b"\xfe" + size.to_bytes(2)
        self._writer.write(b"\x81" + length + b"\0\0\0\0" + text)

    async def recv(self) -> bytes:
        head = await self._reader.readexactly(2)
        size = head[1] if head[1] < 126 else int.from_bytes(await self._reader.readexactly(2))
        return await self._reader.readexactly(size)

    def close(self) -> None:
        self._writer.close()


class Measurement:
    """One connection straight to the agent, and one through the bridge."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, lean: LeanSocket) -> None:
        self._reader = reader
        self._writer = writer
        self._lean = lean

    @classmethod
    async def connect(cls, agent_port: int, bridge_port: int, token: str) -> Measurement:
        reader, writer = await asyncio.open_connection("127.0.0.1", agent_port)
        lean = await LeanSocket.connect(bridge_port, token)
        lean.send(INITIALIZE)
        await lean.recv()
        return cls(reader, writer, lean)

    async def round_trips(self, rounds: int) -> tuple[float, float]:
        """Medians in ms: direct, and through the bridge."""
        await timed(BLOCK, self._direct)
        await timed(BLOCK, self._bridged)
        direct: list[float] = []
        bridged: list[float] = []
        for _ in range(max(1, rounds // BLOCK)):
            direct += await timed(BLOCK, self._direct)
            bridged += await timed(BLOCK, self._bridged)
        return statistics.median(direct) * 1000, statistics.median(bridged) * 1000

    async def updates_per_second(self, updates: int) -> float:
        """How many arrive at the client when the agent sends as fast as it can."""
        begin = time.perf_counter()
        self._lean.send(b'{"jsonrpc":"2.0","id":1,"method":"_flood","params":{"count":%d}}' % updates)
        for _ in range(updates + 1):
            await self._lean.recv()
        return updates / (time.perf_counter() - begin)

    async def _direct(self, number: int) -> None:
        self._writer.write(REQUEST % number + b"\n")
        await self._reader.readline()

    async def _bridged(self, number: int) -> None:
        self._lean.send(REQUEST % number)
        await self._lean.recv()

    def close(self) -> None:
        self._lean.close()
        self._writer.close()


async def measure(measurement: Awaitable[Measurement], processes: list[int], rounds: int, updates: int) -> None:
    """Print one report. `processes` are the ids of all that take part."""
    taken = await measurement
    placed = os.sched_getaffinity(0)
    for place, cores in (("on one core", {min(placed)}), ("free to move", placed)):
        for process in processes:
            os.sched_setaffinity(process, cores)
        direct, bridged = await taken.round_trips(rounds)
        added = bridged - direct
        print(f"round trip, {place:12}: direct {direct:.3f} ms, bridged {bridged:.3f} ms, added {added:.3f} ms")
    print(f"updates, agent to client: {await taken.updates_per_second(updates):,.0f} a second")
    taken.close()


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--rounds", type=int, default=4000)
    arguments.add_argument("--updates", type=int, default=100_000)
    asked = arguments.parse_args()
    spawn = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as folder:
        address = spawn.Queue()
        agent = spawn.Process(target=run_agent, args=(address,), daemon=True)
        agent.start()
        agent_port = address.get(timeout=20)
        flags = {"data_dir": Path(folder), "agent": {"port": agent_port}, "bridge": {"port": 0}}
        bridge = spawn.Process(target=run_bridge, args=(flags, address), daemon=True)
        bridge.start()
        bridge_port = address.get(timeout=20)
        token = tokens.create(Path(folder), "bench", Role.OPERATOR, 3600)
        print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
        try:
            connecting = Measurement.connect(agent_port, bridge_port, token)
            asyncio.run(measure(connecting, [0, agent.pid, bridge.pid], asked.rounds, asked.updates))
        finally:
            for process in (bridge, agent):
                process.terminate()
                process.join(5)


if __name__ == "__main__":
    main()
