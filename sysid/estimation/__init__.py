"""From a structure and records to a Model: PEM, starts, solvers, uncertainty, orders."""
