"""A catkin package of the two nodes."""
