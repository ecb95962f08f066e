"""A small robot of somebody else: an MCP server on stdio with other tool names, which says nothing about its tools."""

from __future__ import annotations

from mcp.server.mcpserver import MCPServer

server = MCPServer("somebody-elses-robot")
said: list[str] = []


@server.tool()
def say_something(sentence: str) -> str:
    """Say a sentence."""
    said.append(sentence)
    return f"said {len(said)} sentences"


@server.tool()
def where_am_i() -> dict[str, float]:
    """Tell the position."""
    return {"x": 1.0, "y": 2.0}


if __name__ == "__main__":
    server.run("stdio")
