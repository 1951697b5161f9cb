"""Vehicles on wheels or tracks: what their wheels let them do, from and to files."""
