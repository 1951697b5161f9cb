"""Navigation filters: from sensor measurements to the estimated pose, one a file."""
