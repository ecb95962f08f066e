"""The cognitive layer: an ACP server upwards, an MCP client downwards, and the loop between them.

It must never import `backend.bridge` or `backend.mcp_robot`, and never trust what a model or a client says
about what is allowed: that is `control/permission.py`.
"""
