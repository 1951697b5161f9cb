"""Logs of any kind of file: their tables, and the readings of sensors in them."""
