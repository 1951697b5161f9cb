"""A robot from an identified plant: wiring, scales, rest, limits, compensation."""
