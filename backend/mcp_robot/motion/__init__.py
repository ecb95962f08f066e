"""Motion and safety: one motion at a time, checked before it begins and while it runs, and the stop latch.

safety.py has the rules before a motion, guard.py those during it, stop.py the latch; pilot.py applies them.
"""
