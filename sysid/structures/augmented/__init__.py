"""A model with effects around it, as a diagnosis makes it."""
