"""Guidance laws: from the estimated pose to references of speed and yaw, one law a file."""
