"""The execution layer: one robot behind MCP tools, a deterministic safety layer, telemetry and a stop.

`robot.py` is the interface to a robot; the simulator and the ROS 2 adapter implement it. Tools, safety rules, telemetry
and stop stand above that interface and are written once. Nothing in here may import the agent or the bridge.

The rooms, each importing only those before it: navigation (grid, planner, path follower, place names), motion (safety
rules, guard, stop latch, pilot), tools (MCP), http; and the two kinds of robots, simulator and ros2. worlds has the
built-in maps. tests/mcp_robot/test_rooms.py holds these rules.
"""
