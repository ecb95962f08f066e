"""A remote robot as a local ACP agent, on stdio or on a TCP port, for clients that cannot dial a WebSocket.

It passes messages on and knows none of their meanings: no sessions, no permissions, no policy.
"""
