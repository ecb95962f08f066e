"""Built-in worlds, one folder each: a map in ROS map_server format and its places, and the scripts that draw them."""
