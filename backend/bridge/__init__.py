"""The interface side: it carries ACP to browsers and other clients, and serves the web app and the scene.

It checks frames, identity and limits, and must never interpret ACP: sessions and permissions are the agent's.
"""
