"""Estimates that follow a log row by row."""
