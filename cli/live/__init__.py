"""``sysid fit --follow``: a plant that is watched while it moves."""
