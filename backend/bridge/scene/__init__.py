"""The live 3D scene: map, walls, robot, laser, path, goal and places, drawn by viser and proxied by the bridge.

It shows what the robot's telemetry says and nothing else; nothing that is done in it can move the robot.
"""
