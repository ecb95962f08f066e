"""A kinematic robot in a map: the backend that needs nothing but this package."""
