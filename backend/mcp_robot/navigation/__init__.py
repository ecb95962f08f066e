"""Where to drive: maps, places, planning and path following. Plain functions; nothing here moves a robot."""
