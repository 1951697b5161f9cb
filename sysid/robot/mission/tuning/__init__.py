"""Tuning: gains of controllers from the plant alone, and by driving."""
