"""Sensors: measurements of the robot's motion beyond the exact wheel speeds."""
