"""Recordings of ROS: ROS 1 bags, ROS 2 sqlite and MCAP."""
