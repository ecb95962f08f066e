"""`offline/commands`: a small command grammar behind litellm, for trying the robot without any language model.

It is no language model and says so. Like a model it knows its messages and its tool list, and nothing else: no
place, no pose, no tool name of this robot may be written into this folder.
"""
