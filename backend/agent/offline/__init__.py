"""`offline/commands`: a small command grammar that works without any language model, for trying the robot.

It is no language model and says so. Like a model it knows its messages, its tool list and the situation, and nothing
else: no place, no pose, no name of this robot's tools may be written into this folder.
"""
