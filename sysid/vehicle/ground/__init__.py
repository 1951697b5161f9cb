"""Soils by name, and what they give and take: sinkage, resistances, drawbar pull, turning."""
