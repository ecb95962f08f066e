"""A package, so that its processes end with its last test (the fixture `robot` has the scope of the package)."""
