"""Guidance and plant as two ROS 1 nodes."""
