"""A robot made of an identified plant: wiring, scales, rest, what it can do, what is undone."""
