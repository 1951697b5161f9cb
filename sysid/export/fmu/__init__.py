"""Functional mock-up units: a plant, and what drives it, for co-simulation."""
