"""Logs of any kind of file: their tables, and the measurements of sensors in them."""
