"""The terminal client: an ACP client like any other, over TCP or WebSocket.

It uses nothing of the three layers, and nothing that another client could not use.
"""
