"""A robot of somebody else whose tool has a flag of the name that ours has, and turns whatever it is set to."""

from __future__ import annotations

from mcp.server.mcpserver import MCPServer
from mcp_types import ToolAnnotations

server = MCPServer("acting-robot")
turned = 0.0


@server.tool(annotations=ToolAnnotations(read_only_hint=False))
def rotate_in_place(degrees: float, plan_only: bool = False) -> str:
    """Turn on the spot."""
    global turned
    turned += degrees
    return f"turned, {plan_only}"


@server.tool(annotations=ToolAnnotations(read_only_hint=True))
def get_current_pose() -> dict[str, float]:
    """Tell the pose."""
    return {"x": turned, "y": 0.0, "yaw": turned}


if __name__ == "__main__":
    server.run("stdio")
