"""Sensors: what the robot reads of its own motion besides the wheels."""
