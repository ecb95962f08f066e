"""A robot that runs ROS 2 and Nav2, as a `Robot`. Nothing outside of this package may import ROS."""
