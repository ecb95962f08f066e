"""ACP, as the agent speaks it with its clients: connections, operations, session updates. No turn runs here."""
