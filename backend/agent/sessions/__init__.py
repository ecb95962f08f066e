"""Sessions: their events in order, who watches them, and the log that keeps them. Nothing here decides or moves."""
