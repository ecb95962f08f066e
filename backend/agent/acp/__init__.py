"""The agent's client side: one ACP connection, its operations, and the updates that it sends. It runs no turn."""
