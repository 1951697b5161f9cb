"""Effects between tracks and ground, which only the pose shows."""
