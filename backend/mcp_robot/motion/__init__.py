"""Motion and safety: one motion at a time, checked before it begins and while it runs, and the stop latch."""
