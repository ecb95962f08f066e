"""The live 3D scene: map, robot, laser, path, goal and places, drawn by viser and served through the bridge's login.

It shows what the robot's telemetry says and nothing else; nothing that is done in it can move the robot. `drawing/` is
what is drawn, `viewers/` who views it and from where; the files here connect both with viser and with browsers.
"""
