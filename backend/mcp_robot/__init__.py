"""The execution layer: one robot behind MCP tools, a deterministic safety layer, telemetry and a stop.

`robot.py` is the seam: the simulator implements it, a ROS 2 adapter can. Everything above it is written once
and must never import a backend, the agent or the bridge.
"""
