"""Where simulation and data disagree, and whether an added effect closes the gap."""
