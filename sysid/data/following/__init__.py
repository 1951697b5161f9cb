"""Logs that are still being written: lines as they come, rows as they are read."""
