"""Vehicles on wheels or tracks: mobility, kinematics and files."""
