"""The MCP tools of the robot: their definitions, results, progress, and the client's sign of life."""
