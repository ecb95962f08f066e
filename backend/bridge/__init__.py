"""The bridge: it connects browsers and other clients to the agent, and serves the web app and the 3D scene.

It checks frames, logins and limits. It must never interpret ACP: sessions and permissions are the agent's business.
"""
