"""A machine simulated from physics, without the formulas of the catalogue of effects."""
