"""Characterising a robot before it drives: its motors, its inertia, its power supply."""
