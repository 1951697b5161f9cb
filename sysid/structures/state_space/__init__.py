"""State space: matrices and their runs, subspace starts, and the structure ``ss``."""
