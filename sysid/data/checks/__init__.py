"""Checks of a log that need no model."""
