"""``sysid fit --follow``: a plant identified online."""
