"""A linear core with effects around it, as a diagnosis makes it."""
