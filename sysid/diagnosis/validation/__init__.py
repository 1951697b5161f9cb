"""Validation: where simulation and data disagree, and whether an effect closes the gap."""
