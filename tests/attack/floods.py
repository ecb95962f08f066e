"""Attacks by number: requests, connections, bytes that are never followed by others."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any

from websockets.exceptions import ConnectionClosed

from tests.attack.target import CLOSED, Broken, Client, Target, attack, said

REQUESTS = 20_000
HALF_OPEN = 1_100


async def _flood(client: Client, method: str, params: dict[str, Any], number: int = REQUESTS) -> str:
    """Send `number` requests at once and count what was answered."""
    waiting = []
    for _ in range(number):
        if client.is_closed:
            break
        try:
            async with asyncio.timeout(60):
                waiting.append(await client.begin(method, params))
        except TimeoutError:
            break
    await asyncio.wait(waiting, timeout=10.0)
    answers = [answer.result() for answer in waiting if answer.done()]
    refusals = sum("error" in answer for answer in answers)
    for answer in answers[-1:]:
        said(answer)
    end = f", then {CLOSED}" if client.is_closed else ""
    return f"of {len(waiting):,} sent {len(answers) - refusals:,} answered, {refusals:,} refused{end}"


@attack("20,000 session/list at once")
async def lists(target: Target) -> str:
    async with target.client() as client:
        return await _flood(client, "session/list", {})


@attack("20,000 session/list at once on each of four connections")
async def lists_on_four(target: Target) -> str:
    async with contextlib.AsyncExitStack() as stack:
        clients = [await stack.enter_async_context(target.client()) for _ in range(4)]
        return (await asyncio.gather(*(_flood(client, "session/list", {}) for client in clients)))[0]


@attack("5,000 session/new at once")
async def sessions(target: Target) -> str:
    async with target.client() as client:
        return await _flood(client, "session/new", {"cwd": "/", "mcpServers": []}, 5_000)


@attack("20,000 requests for the robot's abilities")
async def abilities(target: Target) -> str:
    async with target.client() as client:
        return await _flood(client, "_robot/abilities", {})


@attack("20,000 notifications and 20,000 answers to questions that nobody asked")
async def notifications(target: Target) -> str:
    async with target.client() as client:
        for number in range(REQUESTS):
            await client.notify("session/cancel", {"sessionId": f"none{number}"})
            await client.send({"jsonrpc": "2.0", "id": f"p{number}", "result": {}})
            if client.is_closed:
                return f"{CLOSED} after {number:,}"
        return said(await client.call("session/list", {}))


@attack("2,000 prompts at once in one session")
async def prompts(target: Target) -> str:
    async with target.client() as client:
        session = await client.session() or "none"
        block = {"type": "text", "text": "where are you?"}
        return await _flood(client, "session/prompt", {"sessionId": session, "prompt": [block]}, 2_000)


@attack("60 prompts of 500 kB, one after the other")
async def quota(target: Target) -> str:
    async with target.client() as client:
        session = await client.session() or "none"
        last = ""
        for _ in range(60):
            last = said(await client.prompt(session, "a" * 500_000))
            if client.is_closed:
                break
        return last


@attack("500 loads of a session by a client that reads nothing")
async def reads_nothing(target: Target) -> str:
    async with target.client() as client:
        session = await client.session() or "none"
        await client.prompt(session, "which places are there?")
        client.reading.cancel()
        client.socket.transport.pause_reading()
        try:
            async with asyncio.timeout(20):
                for _ in range(500):
                    await client.begin("session/load", {"sessionId": session, "cwd": "/", "mcpServers": []})
        except TimeoutError:
            return "the instance stopped reading"
        return "read, and answered into its own buffers"


@attack("20,000 pings, and a frame in 10,000 fragments")
async def pings(target: Target) -> str:
    async with target.client() as client:
        with contextlib.suppress(ConnectionClosed):
            for _ in range(REQUESTS):
                await client.socket.ping()
            await client.socket.send(b"x" for _ in range(10_000))
        return said(await client.call("session/list", {}))


async def _half(target: Target, to: tuple[str, int], first: bytes, number: int) -> tuple[int, int]:
    """Open `number` connections that send `first` and nothing more. Returns how many could be opened, and how many are
    still open after a while."""
    opened: list[tuple[asyncio.StreamReader, asyncio.StreamWriter]] = []
    try:
        for _ in range(number):
            try:
                async with asyncio.timeout(2):
                    reader, writer = await asyncio.open_connection(*to)
            except (OSError, TimeoutError):
                break
            opened.append((reader, writer))
            with contextlib.suppress(OSError):
                writer.write(first)
        await asyncio.sleep(3.0)
        return len(opened), sum(not reader.at_eof() for reader, _ in opened)
    finally:
        for _, writer in opened:
            writer.transport.abort()


@attack("1,100 connections to the bridge with half a request each")
async def half_requests(target: Target) -> str:
    opened, still = await _half(target, target.address, b"GET / HTTP/1.1\r\nHost: a\r\nX", HALF_OPEN)
    return f"{opened:,} opened, {still:,} open 3 s later"


@attack("300 connections to the bridge that promise a body and send none")
async def half_bodies(target: Target) -> str:
    first = b"POST /api/login HTTP/1.1\r\nHost: a\r\nContent-Type: application/json\r\nContent-Length: 16000\r\n\r\n{"
    opened, still = await _half(target, target.address, first, 300)
    return f"{opened:,} opened, {still:,} open 3 s later"


@attack("15 connections to the agent with 15 MB each and no newline")
async def no_newline(target: Target) -> str:
    if target.tcp is None:
        return "not tried: the agent's own port is out of reach"
    closed = 0

    async def send() -> None:
        nonlocal closed
        assert target.tcp is not None
        async with target.raw(target.tcp) as (reader, writer):
            try:
                for _ in range(15):
                    writer.write(b"a" * 1_000_000)
                    async with asyncio.timeout(5):
                        await writer.drain()
            except (OSError, TimeoutError):
                closed += 1
                return
            with contextlib.suppress(TimeoutError, OSError):
                async with asyncio.timeout(2):
                    closed += not await reader.read(1)

    await asyncio.gather(*(send() for _ in range(15)))
    if closed < 15:
        raise Broken(f"{15 - closed} connections kept 15 MB each before any login")
    return "all 15 were closed"


@attack("500 silent connections to the agent")
async def silent(target: Target) -> str:
    if target.tcp is None:
        return "not tried: the agent's own port is out of reach"
    opened, still = await _half(target, target.tcp, b"", 500)
    return f"{opened:,} opened, {still:,} open 3 s later"
