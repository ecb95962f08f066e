"""Draws the picture of the simulated camera: the map as if it were a building. Nothing may navigate by it."""
