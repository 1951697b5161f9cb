"""Choosing orders, delays and structures, and comparing models."""
