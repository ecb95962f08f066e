"""The robot server's HTTP: access, routes, telemetry and camera streams. No motion is decided here."""
