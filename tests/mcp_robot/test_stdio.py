"""The robot server over stdio: MCP on standard input and output, telemetry and stop still on its port."""

from __future__ import annotations

import socket
import sys
from pathlib import Path

import httpx
from mcp import Client, StdioServerParameters

from backend import identity

PROGRAM = """
import asyncio, sys
from pathlib import Path
from backend import config
from backend.mcp_robot.server import serve
settings = config.Settings(data_dir=Path(sys.argv[1]), robot=config.Robot(port=int(sys.argv[2]), time_scale=20))
asyncio.run(serve(settings, stdio=True))
"""


async def test_tools_work_over_stdio_while_stop_works_over_http(tmp_path: Path) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = StdioServerParameters(command=sys.executable, args=["-c", PROGRAM, str(tmp_path), str(port)])
    async with Client(command) as client:
        assert len((await client.list_tools()).tools) == 8
        result = await client.call_tool("rotate_in_place", {"degrees": 30})
        assert not result.is_error
        token = identity.shared_secret(tmp_path, identity.ROBOT_TOKEN).decode()
        async with httpx.AsyncClient(headers={"Authorization": f"Bearer {token}"}) as http:
            await http.post(f"http://127.0.0.1:{port}/stop", json={"by": "Ana"})
        refused = await client.call_tool("rotate_in_place", {"degrees": 30})
        assert refused.is_error
