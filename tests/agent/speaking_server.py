"""An MCP server over HTTP with one tool, which speaks; started with `louder`, the tool takes one parameter more."""

from __future__ import annotations

import sys

import uvicorn
from mcp.server.mcpserver import MCPServer

server = MCPServer("speaking")


def speak(text: str) -> str:
    """Say something."""
    return f"said {text}"


def speak_louder(text: str, volume: float = 1.0) -> str:
    """Say something."""
    return f"said {text} at {volume}"


if __name__ == "__main__":
    server.tool(name="speak")(speak_louder if "louder" in sys.argv else speak)
    app = server.streamable_http_app()
    uvicorn.run(app, host="127.0.0.1", port=int(sys.argv[1]), log_level="error", timeout_graceful_shutdown=1)
