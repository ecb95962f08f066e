"""The robot server over stdio: MCP on standard input and output, telemetry and stop still on its port."""

from __future__ import annotations

import asyncio
import signal
import socket
import sys
from pathlib import Path

import httpx
import pytest
from mcp import Client, StdioServerParameters

from backend import identity
from backend.mcp_robot.stdio_transport import read_lines
from tests.processes import PATIENCE_S, free_port

pytestmark = pytest.mark.processes

PROGRAM = """
import asyncio, sys
from pathlib import Path
from backend import config
from backend.mcp_robot.server import serve
settings = config.Settings(data_dir=Path(sys.argv[1]), robot=config.Robot(port=int(sys.argv[2]), time_scale=20))
asyncio.run(serve(settings, stdio=True))
"""


async def test_tools_work_over_stdio_while_stop_works_over_http(tmp_path: Path) -> None:
    port = free_port()
    command = StdioServerParameters(command=sys.executable, args=["-c", PROGRAM, str(tmp_path), str(port)])
    async with Client(command) as client:
        assert len((await client.list_tools()).tools) == 8
        result = await client.call_tool("rotate_in_place", {"degrees": 30})
        assert not result.is_error
        token = identity.shared_secret(tmp_path, identity.ROBOT_TOKEN).decode()
        async with httpx.AsyncClient(headers={"Authorization": f"Bearer {token}"}) as http:
            await http.post(f"http://127.0.0.1:{port}/stop", params={"by": "Ana"})
        refused = await client.call_tool("rotate_in_place", {"degrees": 30})
        assert refused.is_error


@pytest.mark.parametrize("ending", ["end of input", signal.SIGINT, signal.SIGTERM])
async def test_it_ends_when_its_input_does_or_when_told_to(tmp_path: Path, ending: str | signal.Signals) -> None:
    pipe = asyncio.subprocess.PIPE
    port = free_port()
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", PROGRAM, str(tmp_path), str(port), stdin=pipe, stdout=pipe, stderr=pipe
    )
    assert process.stdin
    try:
        await answers(port)
        if isinstance(ending, signal.Signals):
            process.send_signal(ending)
        else:
            process.stdin.close()
        async with asyncio.timeout(PATIENCE_S):
            await process.wait()
    finally:
        if process.returncode is None:
            process.kill()
        process.stdin.close()
        output, _ = await process.communicate()
    assert output == b""


async def answers(port: int) -> None:
    """Wait until a server on that port does."""
    async with asyncio.timeout(PATIENCE_S), httpx.AsyncClient() as http:
        while True:
            try:
                await http.get(f"http://127.0.0.1:{port}/health")
                return
            except httpx.TransportError:
                await asyncio.sleep(0.02)


async def test_lines_arrive_whole_however_they_were_cut() -> None:
    reading, writing = socket.socketpair()
    with reading:
        with writing:
            text = "one\ntwo ü\n\nlast".encode()
            for byte in range(len(text)):
                writing.sendall(text[byte : byte + 1])
        assert [line async for line in read_lines(reading.fileno())] == ["one", "two ü", "", "last"]
