"""Storage of models, comparisons and plants between commands."""
