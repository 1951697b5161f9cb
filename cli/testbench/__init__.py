"""``sysid bench``: a robot's parts on the test bench."""
