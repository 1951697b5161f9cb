"""Offsets of a log: removed, known or estimated."""
