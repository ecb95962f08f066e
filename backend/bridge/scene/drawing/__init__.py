"""What the scene shows: each telemetry message becomes nodes of viser's scene graph. It knows no viewers."""
