"""A robot of somebody else: an MCP server over HTTP that shares no code with ours, with or without a path `/stop`.

Its arguments are a port, a file and `stop` or `no-stop`. Each request is a line of the file: method, path, query, and
the header `Authorization`. So is each body, and each thing that it does. Its turning lasts until the call is cancelled.
"""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path
from typing import Any

import uvicorn
from mcp.server.mcpserver import MCPServer
from mcp_types import ToolAnnotations
from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

FILE = Path(sys.argv[2])
server = MCPServer("somebody-elses-robot")


def note(line: list[Any]) -> None:
    with FILE.open("a") as file:
        file.write(json.dumps(line) + "\n")


@server.tool(annotations=ToolAnnotations(read_only_hint=False))
async def rotate_in_place(degrees: float) -> str:
    """Turn on the spot, and go on turning."""
    note(["turning", degrees])
    try:
        await asyncio.Event().wait()
    except asyncio.CancelledError:
        note(["cancelled"])
        raise
    return "turned"


if sys.argv[3] == "stop":

    @server.custom_route("/stop", methods=["POST"])
    async def stop(request: Request) -> JSONResponse:
        """Brake."""
        return JSONResponse({"stopped": {"by": (await request.json())["by"], "at": 1.0}})


class Recorded:
    """The application, with a line in the file for every request."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = dict(scope["headers"])
        path = scope["path"]
        secret = headers.get(b"authorization", b"").decode()
        note([scope.get("method", scope["type"]), path, scope["query_string"].decode(), secret])

        async def recorded() -> Message:
            message = await receive()
            if message["type"] == "http.request":
                note(["body", path, message.get("body", b"").decode()])
            return message

        await self._app(scope, recorded, send)


if __name__ == "__main__":
    app = Recorded(server.streamable_http_app())
    uvicorn.run(app, host="127.0.0.1", port=int(sys.argv[1]), log_level="error", timeout_graceful_shutdown=1)
