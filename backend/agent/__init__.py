"""The cognitive layer: an ACP server upwards, an MCP client downwards, and the loop between them.

It must never import `backend.bridge` or `backend.mcp_robot`. Whether a tool may be called is for `policy` and
`permissions` to decide, never for a model or a client.
"""
