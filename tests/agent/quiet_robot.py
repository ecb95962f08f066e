"""A small robot of somebody else that can only tell where it is: whatever more an agent can do came from elsewhere."""

from __future__ import annotations

from mcp.server.mcpserver import MCPServer
from mcp_types import ToolAnnotations

server = MCPServer("quiet-robot")


@server.tool(annotations=ToolAnnotations(read_only_hint=True))
def where_am_i() -> dict[str, float]:
    """Tell the position."""
    return {"x": 1.0, "y": 2.0}


if __name__ == "__main__":
    server.run("stdio")
