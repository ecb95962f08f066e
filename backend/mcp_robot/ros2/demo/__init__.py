"""A stand-in for a ROS 2 robot: the simulator behind real ROS nodes, to try robot-acp without a robot."""
