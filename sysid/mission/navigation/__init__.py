"""Navigation filters: from what the sensors read to the estimated pose, one a file."""
