"""Soils by name and their effects: sinkage, resistances, drawbar pull, turning."""
