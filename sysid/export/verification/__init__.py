"""Comparison of every runtime of a plant package with Python."""
