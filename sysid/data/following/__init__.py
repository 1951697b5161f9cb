"""Logs that are still being written: lines as they arrive, and rows made of them."""
