"""Recordings of ROS: their topics, which field is which column, one log of their streams."""
