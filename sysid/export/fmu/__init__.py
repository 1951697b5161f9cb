"""Functional mock-up units of a plant and its controller, for co-simulation."""
