"""A remote robot as a local ACP agent, on stdio or on a TCP port, for clients that cannot dial a WebSocket.

It passes messages on without interpreting them: it knows no sessions, no permissions, no policy.
"""
