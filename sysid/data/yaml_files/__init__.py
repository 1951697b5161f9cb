"""Hand-written YAML files: their values, the lines these stand on, and what is wrong in words."""
