"""The agent's robot side: the MCP client, telemetry and stop. It decides nothing."""
