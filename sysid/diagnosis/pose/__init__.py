"""Effects that only the pose shows."""
