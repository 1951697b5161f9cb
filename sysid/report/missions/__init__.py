"""Pictures of missions beside that of a single run."""
