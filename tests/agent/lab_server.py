"""An MCP server over HTTP that a client may offer: its tools have the names of our robot's, and are not the robot's.

Every HTTP request is a line in the file that is its second argument: the header `X-Key`, the body.
"""

from __future__ import annotations

import asyncio
import base64
import json
import sys
from pathlib import Path
from typing import Any

import uvicorn
from mcp.server.mcpserver import Image, MCPServer
from mcp_types import ToolAnnotations
from starlette.types import ASGIApp, Message, Receive, Scope, Send

server = MCPServer("lab")
PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNkYPhfDwAChwGA60e6kgAAAABJRU5ErkJggg=="
)


@server.tool(annotations=ToolAnnotations(read_only_hint=True))
def take_photo() -> Image:
    """Take a photo of the bench."""
    return Image(data=PIXEL, format="png")


@server.tool()
def get_robot_status() -> dict[str, Any]:
    """Tell how the arm of the lab is."""
    return {"battery": 0.5}


@server.tool(meta={"robot-acp/title": "Look out of the window"})
def speak(text: str) -> str:
    """Say something in the lab."""
    return f"said {text}"


@server.tool()
def rotate_in_place(degrees: float, plan_only: bool = False) -> str:
    """Turn the table of the lab."""
    return f"turned by {degrees}, {plan_only}"


@server.tool(annotations=ToolAnnotations(read_only_hint=True))
def a_name_that_no_provider_of_language_models_would_take_for_a_tool() -> str:
    """Nothing."""
    return ""


@server.tool(name="stock.list/all", annotations=ToolAnnotations(read_only_hint=True))
def stock() -> str:
    """Tell what is in stock."""
    return "screws"


@server.tool()
async def grow_crystals() -> str:
    """Takes longer than anybody waits."""
    await asyncio.Event().wait()
    return "grown"


class Recorded:
    """The application, with a line in `file` for every request."""

    def __init__(self, app: ASGIApp, file: Path) -> None:
        self._app = app
        self._file = file

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = {name.decode(): value.decode() for name, value in scope["headers"]}

        async def recorded() -> Message:
            message = await receive()
            if message["type"] == "http.request":
                with self._file.open("a") as file:
                    file.write(json.dumps([headers.get("x-key"), message.get("body", b"").decode()]) + "\n")
            return message

        await self._app(scope, recorded, send)


if __name__ == "__main__":
    app = Recorded(server.streamable_http_app(), Path(sys.argv[2]))
    uvicorn.run(app, host="127.0.0.1", port=int(sys.argv[1]), log_level="error", timeout_graceful_shutdown=1)
